// Uploaded clips: read, shown, and decided on one by one.

import { ask, forget, get, upload } from "./api.js";
import { button, byId, el, player, plural, ranking, say } from "./dom.js";

const POLL = 400; // milliseconds
const RANKED = 5;

export class Uploads {
  // studio: { state, tau(), refresh() }
  constructor(studio) {
    this.studio = studio;
    this.clips = new Set();
    addEventListener("pagehide", () => { for (const clip of this.clips) clip.leave(); });
    const drop = byId("drop"), files = byId("files");
    files.addEventListener("change", () => { this.sendAll(files.files); files.value = ""; });
    // A file that misses the frame must not replace the page.
    addEventListener("dragover", (event) => { event.preventDefault(); drop.classList.add("over"); });
    addEventListener("dragleave", (event) => { if (!event.relatedTarget) drop.classList.remove("over"); });
    addEventListener("drop", (event) => {
      event.preventDefault();
      drop.classList.remove("over");
      this.sendAll(event.dataTransfer.files);
    });
  }

  sendAll(files) {
    for (const file of files) this.send(file, file.name, this.options());
  }

  // What is filled in, by the names that `read_any` has.
  options() {
    return Object.fromEntries([...new FormData(byId("options"))].filter(([, value]) => value !== ""));
  }

  // label: what the clip shows, where that is known.
  send(file, name, options, label = "") {
    const clip = new Clip(this, file, name, label);
    this.clips.add(clip);
    byId("clips").prepend(clip.element);
    byId("uploads").hidden = false;
    clip.look();
    clip.send(options);
  }

  // What is enrolled, or tau, has changed.
  update() { for (const clip of this.clips) clip.update(); }
  judge() { for (const clip of this.clips) clip.judge(); }

  remove(clip) {
    const focused = clip.element.contains(document.activeElement);
    this.clips.delete(clip);
    clip.element.remove();
    byId("uploads").hidden = this.clips.size === 0;
    if (focused) byId(this.clips.size ? "uploads-title" : "lead-title").focus();
  }
}

class Clip {
  constructor(uploads, file, name, shows) {
    Object.assign(this, { uploads, file, name, shows, id: null, answer: null, gone: new AbortController() });
    this.body = el("div");
    this.element = el("article", { class: "card", "aria-label": `Clip ${name}` },
      el("div", { class: "head" }, el("h3", {}, name)), this.body);
  }

  async send(options) {
    this.wait("sending");
    const { file } = this;
    try {
      const limit = this.uploads.studio.state?.limit;
      if (limit && file.size > limit) {
        throw new Error(`The file is larger than ${limit / 1e6} MB, more than is taken here. Cut out ` +
          "the action, or use the command line, which reads files where they are.");
      }
      this.id = (await upload(file, this.name, options, this.gone.signal)).id;
      await this.follow();
    } catch (error) {
      if (error.name !== "AbortError") this.fail(error.message);
    }
  }

  async follow() {
    while (!this.gone.signal.aborted) {
      const answer = await get(`/api/clips/${this.id}`);
      if (this.gone.signal.aborted) return;
      if (answer.state === "failed") return this.fail(answer.message);
      if (answer.state === "ready") return this.show(answer);
      this.wait("looking", answer.seconds, answer.total);
      await new Promise((done) => setTimeout(done, POLL));
    }
  }

  // The newest is brought into view, unless another one is being decided on.
  look() {
    const clips = byId("clips");
    if (clips.firstChild === this.element && !clips.contains(document.activeElement)) this.element.scrollIntoView({ block: "nearest" });
  }

  wait(stage, seconds, total) {
    if (!this.bar?.isConnected) {
      this.bar = el("progress", { max: 1, "aria-label": `Progress of ${this.name}` });
      this.stage = el("p", { class: "muted" });
      this.body.replaceChildren(this.stage, this.bar,
        el("div", { class: "row" }, button("Cancel", () => this.discard("cancelled"), { "aria-label": `Cancel ${this.name}` })));
    }
    if (total > 0) this.bar.value = Math.min(seconds / total, 1);
    const far = total > 0 ? `: ${seconds.toFixed(1)} of ${total.toFixed(1)} s` : "";
    this.stage.textContent = (stage === "sending" ? "Being read in" : "Looking for the person") + far;
  }

  fail(message) {
    const text = message.startsWith(this.name) ? message : `${this.name}: ${message}`;
    this.body.replaceChildren(el("p", { class: "problem", role: "alert" }, text),
      el("div", { class: "row" },
        button("Try again", () => this.send(this.uploads.options()), { "aria-label": `Try ${this.name} again` }),
        button("Dismiss", () => this.discard(""), { "aria-label": `Dismiss ${this.name}` })));
  }

  show(answer) {
    this.answer = answer;
    this.file = null;
    const { decision } = answer;
    this.stage = el("div");
    this.verdict = el("p", { class: "verdict" });
    this.ranked = el("div");
    this.label = el("input", {
      list: "labels", maxlength: 100, autocomplete: "off", required: true,
      value: decision?.accepted ? decision.nearest : this.shows,
    });
    const form = el("form", { submit: (event) => { event.preventDefault(); this.enroll(false); } },
      el("label", {}, "Name of the action", this.label),
      el("button", { type: "submit", class: "main" }, "Enrol"),
      button("Never accept", () => this.enroll(true), { title: "Keep it as what must never be accepted" }),
      button("Discard", () => this.discard("discarded"), { "aria-label": `Discard ${this.name}` }));
    const notes = el("ul", { class: "notes" },
      el("li", {}, `${plural(answer.frames, "frame")}, ${answer.seconds.toFixed(1)} s`),
      ...answer.notes.map((note) => el("li", {}, note)));
    this.problem = el("p", { class: "problem", role: "alert", hidden: true });
    this.body.replaceChildren(this.stage,
      this.verdict, this.ranked, notes, form, this.problem);
    this.draw();
    this.judge();
    this.look();
    say(`${this.name}: ${this.verdict.textContent}`);
  }

  // The clip, and beside it, in step, an example of the action that it is nearest to.
  async draw() {
    const nearest = this.answer.decision?.nearest ?? "";
    if (nearest === this.beside) return;
    this.beside = nearest;
    const shown = [{ caption: "this clip", figure: this.answer.figure }];
    this.stage.replaceChildren(player(this.name, shown));
    const action = this.uploads.studio.state?.actions.find((each) => each.label === nearest);
    if (!action) return;
    const figure = await get(`/api/examples/${action.examples[0].id}`).catch(() => null);
    if (figure === null || this.beside !== nearest) return;
    this.stage.replaceChildren(player(this.name, [...shown, { caption: `nearest: ${nearest}`, figure }]));
  }

  async update() {
    if (!this.answer) return;
    try {
      this.answer.decision = (await get(`/api/clips/${this.id}`)).decision;
      this.draw();
      this.judge();
    } catch (error) {
      this.refuse(error.message);
    }
  }

  // Words for the decision, under the tau that the slider shows.
  judge() {
    if (!this.answer) return;
    const { decision } = this.answer;
    this.ranked.replaceChildren();
    if (!decision) {
      this.verdict.className = "verdict none";
      this.verdict.textContent = "Nothing is enrolled to compare it with.";
      return;
    }
    const tau = this.tau(decision);
    const accepted = decision.confidence > tau && !decision.negative_is_nearer;
    const sure = `${decision.confidence.toFixed(2)} ${decision.confidence > tau ? ">" : "≤"} τ ${tau.toFixed(2)}`;
    this.verdict.className = `verdict${accepted ? " yes" : ""}`;
    const { start, end } = decision.part ?? { start: 0, end: Infinity };
    const part = end - start < 0.98 * this.answer.seconds ? `, from ${start.toFixed(1)} s to ${end.toFixed(1)} s` : "";
    this.verdict.textContent = accepted
      ? `Recognised: ${decision.nearest} (confidence ${sure}${part})`
      : `Rejected (nearest ${decision.nearest}, confidence ${sure}${decision.negative_is_nearer ? ", but a negative is nearer" : ""})`;
    this.ranked.append(ranking(decision.ranking.slice(0, RANKED), tau));
  }

  tau(decision) { return this.uploads.studio.tau() ?? decision.tau; }

  refuse(message) {
    this.problem.textContent = message;
    this.problem.hidden = false;
  }

  async enroll(negative) {
    const label = this.label.value.trim();
    if (!negative && !label) {
      this.refuse("Name the action first.");
      this.label.focus();
      return;
    }
    try {
      const answer = await ask("POST", `/api/clips/${this.id}/enroll`, { label, negative });
      const what = answer.added ? "enrolled" : "was there already";
      const warned = answer.warnings.length ? ` It is ${answer.warnings.join(", and ")}.` : "";
      say(`${this.name} ${what} as ${negative ? "what is never accepted" : answer.label}.${warned}`);
      this.uploads.remove(this);
      await this.uploads.studio.refresh();
    } catch (error) {
      this.refuse(error.message);
    }
  }

  leave() {
    this.gone.abort();
    if (this.id) forget(this.id);
  }

  discard(word) {
    this.leave();
    if (word) say(`${this.name} ${word}.`);
    this.uploads.remove(this);
  }
}
