// The browser's camera: recorded as a clip, or looked at live.

import { token } from "./api.js";
import { byId, el, ranking, say } from "./dom.js";

const SOURCE = "source"; // stands for the camera that the command names
const COUNTDOWN = 3; // seconds
const WIDTH = 480; // pixels of a live picture
const QUALITY = 0.8; // of its JPEG
const KINDS = ["video/webm;codecs=vp8", "video/webm", "video/mp4"];
const EVENTS = 6; // on the list
const RATED = 20; // pictures that the rate is computed from
const SLOW = 3; // pictures a second: farther apart, they are not taken for one motion

const sleep = (seconds) => new Promise((done) => setTimeout(done, 1000 * seconds));
// One that is not open yet would be closed with a complaint.
const closed = (socket) => (socket?.readyState === WebSocket.CONNECTING ? socket.addEventListener("open", () => socket.close()) : socket?.close());

export class Camera {
  // studio: { state, tau() }; uploads takes what is recorded
  constructor(studio, uploads) {
    Object.assign(this, { studio, uploads, stream: null, source: null, socket: null, busy: false, starting: false, number: 0, last: null, times: [] });
    this.video = byId("video");
    this.picture = el("canvas");
    byId("camera-switch").addEventListener("click", () => (this.stream ? this.stop() : this.start()));
    byId("record").addEventListener("click", () => this.record());
    byId("fill").hidden = !document.fullscreenEnabled; // not on every phone
    byId("fill").addEventListener("click", () => (document.fullscreenElement ? document.exitFullscreen() : byId("camera").requestFullscreen()));
    byId("which").addEventListener("change", () => { this.stop(); this.start(byId("which").value); });
  }

  async start(device = this.studio.state?.source ? SOURCE : "") {
    this.wanted = device;
    if (this.starting) return;
    this.starting = true;
    for (let opened = null; opened !== this.wanted; ) { // another one may be chosen meanwhile
      if (opened !== null) this.stop();
      opened = this.wanted;
      await this.open(opened);
    }
    this.starting = false;
  }

  async open(device) {
    const size = { width: { ideal: 640 }, height: { ideal: 480 }, frameRate: { ideal: 30 } };
    try {
      if (device === SOURCE) this.stream = await this.named();
      else {
        if (!navigator.mediaDevices) throw new Error("this browser gives pages no camera");
        const video = { ...size, ...(device ? { deviceId: { exact: device } } : {}) };
        this.stream = await navigator.mediaDevices.getUserMedia({ video, audio: false });
      }
    } catch (error) {
      this.problem(cameraProblem(error));
      return;
    }
    this.problem("");
    this.stream.getVideoTracks()[0].addEventListener("ended", () => this.stop());
    this.video.srcObject = this.stream;
    byId("camera").hidden = false;
    byId("camera-switch").textContent = "Stop the camera";
    byId("events").replaceChildren();
    this.verdict("none", "Looking …");
    const { stream } = this;
    await this.video.play().catch(() => {}); // stopped again meanwhile
    if (this.stream !== stream) return;
    const current = device === SOURCE ? SOURCE : stream.getVideoTracks()[0].getSettings().deviceId;
    this.video.parentElement.style.aspectRatio = `${this.video.videoWidth} / ${this.video.videoHeight}`;
    byId("camera").scrollIntoView({ block: "nearest" });
    await this.offerCameras(current);
    this.connect();
  }

  stop(why = "") {
    this.stream?.getTracks().forEach((track) => track.stop());
    this.stream = null;
    this.video.srcObject = null;
    closed(this.socket);
    closed(this.source);
    this.socket = this.source = null;
    byId("camera").hidden = true;
    byId("camera-switch").textContent = "Use the camera";
    this.problem(why);
  }

  problem(text) {
    byId("camera-problem").textContent = text;
    byId("camera-problem").hidden = !text;
  }

  async offerCameras(current) {
    const devices = (await navigator.mediaDevices?.enumerateDevices()) ?? [];
    const cameras = devices.filter((device) => device.kind === "videoinput");
    const { source } = this.studio.state ?? {};
    if (source) cameras.push({ deviceId: SOURCE, label: source });
    byId("cameras").hidden = cameras.length < 2;
    byId("which").replaceChildren(...cameras.map((camera, place) =>
      el("option", { value: camera.deviceId, selected: camera.deviceId === current }, camera.label || `camera ${place + 1}`)));
  }

  // The camera that the command names: its pictures come from the server, and make a stream here.
  named() {
    const canvas = el("canvas"), g = canvas.getContext("2d");
    const source = new WebSocket(`ws://${location.host}/api/source`, ["actioncli", token()]);
    this.source = source;
    let silent = false;
    return new Promise((begin, fail) => {
      const end = (why) => { fail(new Error(why)); if (source === this.source) this.stop(why); };
      source.addEventListener("message", async ({ data }) => {
        const word = typeof data === "string";
        const { error } = word ? JSON.parse(data) : {};
        if (error) { end(error); return; }
        if (word !== silent) this.problem(word ? "The camera sends no picture; waiting for it." : "");
        silent = word;
        if (!word) {
          const picture = await createImageBitmap(data);
          if (canvas.width !== picture.width || canvas.height !== picture.height)
            Object.assign(canvas, { width: picture.width, height: picture.height });
          g.drawImage(picture, 0, 0);
          begin(this.stream ?? canvas.captureStream());
        }
        if (source.readyState === WebSocket.OPEN) source.send("next");
      });
      source.addEventListener("close", () => end("The camera was stopped: actioncli does not answer."));
    });
  }

  connect() {
    if (!this.stream) return;
    const socket = new WebSocket(`ws://${location.host}/api/live`, ["actioncli", token()]);
    this.socket = socket;
    this.times = [];
    socket.addEventListener("open", () => { this.sendTau(); this.sendPicture(socket); });
    socket.addEventListener("message", (event) => {
      const answer = JSON.parse(event.data);
      if (answer.error) this.stop(answer.error);
      else if (answer.bones) this.bones = answer.bones;
      else {
        this.show(answer);
        this.sendPicture(socket);
      }
    });
    socket.addEventListener("close", () => {
      if (socket === this.socket) this.stop("The camera was stopped: actioncli does not answer.");
    });
  }

  tauChanged() {
    this.sendTau();
    if (this.last) this.judge(this.last);
  }

  sendTau() {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ tau: this.studio.tau() }));
  }

  // One picture at a time is under way, so that none waits in a queue.
  async sendPicture(socket) {
    await new Promise(requestAnimationFrame);
    while (this.busy && socket === this.socket) await sleep(0.1);
    const { videoWidth, videoHeight } = this.video;
    if (socket !== this.socket || socket.readyState !== WebSocket.OPEN || !videoWidth) return;
    this.picture.width = Math.min(WIDTH, videoWidth);
    this.picture.height = Math.round((videoHeight * this.picture.width) / videoWidth);
    this.picture.getContext("2d").drawImage(this.video, 0, 0, this.picture.width, this.picture.height);
    const time = new DataView(new ArrayBuffer(8));
    time.setFloat64(0, performance.now() / 1000, true);
    const jpeg = await new Promise((done) => this.picture.toBlob(done, "image/jpeg", QUALITY));
    if (socket.readyState === WebSocket.OPEN) socket.send(new Blob([time, jpeg]));
  }

  show(answer) {
    this.draw(answer.points);
    const now = performance.now();
    this.times = [...this.times.slice(-RATED), now];
    const rate = (1000 * (this.times.length - 1)) / Math.max(now - this.times[0], 1);
    const view = !answer.seen ? "Nobody is in view" : answer.whole
      ? "The body is in view" : "Step back until head and hands, and feet if they take part, are in the picture";
    const slow = this.times.length > 5 && rate < SLOW ? ", too few to follow: this machine is busy" : "";
    byId("view").textContent = `${view}, ${rate.toFixed(rate < SLOW ? 1 : 0)} pictures/s${slow}`;
    for (const event of answer.events ?? []) this.tell(event);
    this.last = answer;
    this.judge(answer);
  }

  // The repetitions of a set share a line, which counts them.
  tell({ label, confidence, repetitions }) {
    const events = byId("events");
    if (repetitions > 1) events.firstChild?.remove();
    events.prepend(el("li", {}, el("b", {}, label), " ",
      el("span", { class: "times" }, `×${repetitions}`), " ", el("span", { class: "muted" }, confidence.toFixed(2))));
    while (events.children.length > EVENTS) events.lastChild.remove();
  }

  judge(answer) {
    if (!answer.ranking) {
      byId("ranking").replaceChildren();
      this.verdict("none", "Nothing is enrolled to compare it with.");
      return;
    }
    const labels = (this.studio.state?.actions ?? []).filter((action) => !action.negative).map((action) => action.label);
    const sure = new Map(answer.ranking.map((seen) => [seen.label, seen.confidence]));
    const tau = this.studio.tau() ?? answer.tau;
    const rows = labels.map((label) => ({ label, confidence: sure.get(label) ?? null }));
    byId("ranking").replaceChildren(ranking(rows.sort((a, b) => (b.confidence ?? -1) - (a.confidence ?? -1)).slice(0, 6), tau));
    const best = answer.ranking[0];
    if (answer.current) this.verdict("yes", answer.current);
    else if (best) this.verdict("", `None of the actions (nearest ${best.label})`);
    else this.verdict("none", answer.seen ? "None of the actions" : "Nobody is in view");
  }

  // Only what is new: it is read out.
  verdict(kind, text) {
    const here = byId("verdict");
    here.className = `verdict ${kind}`;
    if (here.textContent !== text) here.textContent = text;
  }

  draw(points) {
    const canvas = byId("overlay"), g = canvas.getContext("2d");
    canvas.width = this.video.videoWidth;
    canvas.height = this.video.videoHeight;
    if (!points || !this.bones) return;
    const style = getComputedStyle(canvas);
    g.lineCap = "round";
    for (const [a, b, side, share] of this.bones) {
      g.lineWidth = share * canvas.width / 120;
      g.globalAlpha = Math.min(points[a][2], points[b][2]) > 0.5 ? 1 : 0.25;
      g.strokeStyle = style.getPropertyValue(`--film-${side}`);
      g.beginPath();
      g.moveTo(points[a][0] * canvas.width, points[a][1] * canvas.height);
      g.lineTo(points[b][0] * canvas.width, points[b][1] * canvas.height);
      g.stroke();
    }
  }

  async record() {
    if (this.busy || !this.stream) return;
    const seconds = Number(byId("seconds").value), count = byId("count"), { stream } = this;
    this.button(true);
    count.hidden = false;
    for (let left = COUNTDOWN; left > 0 && this.stream === stream; left--) {
      count.textContent = `in ${left}`;
      say(`Recording in ${left}`);
      await sleep(1);
    }
    try {
      if (this.stream !== stream) return;
      this.busy = true; // the machine is left to the recording
      this.draw(null);
      count.textContent = "recording";
      say(`Recording for ${seconds} s`);
      const kind = KINDS.find((each) => MediaRecorder.isTypeSupported(each)) ?? "";
      const parts = [], recorder = new MediaRecorder(stream, { mimeType: kind, videoBitsPerSecond: 4e6 });
      recorder.addEventListener("dataavailable", (event) => parts.push(event.data));
      const stopped = new Promise((done) => recorder.addEventListener("stop", done));
      recorder.start();
      await sleep(seconds);
      if (recorder.state !== "inactive") recorder.stop();
      await stopped;
      const suffix = kind.includes("mp4") ? "mp4" : "webm";
      say("Recorded.");
      this.uploads.send(new Blob(parts), `camera ${++this.number}.${suffix}`, {});
    } catch (error) {
      this.problem(`The recording failed: ${error.message}.`);
    } finally {
      this.busy = false;
      count.hidden = true;
      this.button(false);
    }
  }

  button(recording) { byId("record").disabled = recording; }
}

function cameraProblem(error) {
  const messages = {
    NotAllowedError: "The browser may not use a camera on this page: allow it in the address bar, then try again.",
    NotFoundError: "The browser finds no camera. Drop a video instead.",
    NotReadableError: "The camera cannot be read; another program may be using it.",
  };
  return messages[error.name] ?? `The camera cannot be used: ${error.message.replace(/\.$/, "")}.`;
}
