// Clips that were sent: read, shown, and decided on one by one.

import { ask, forget, get, upload } from "./api.js";
import { button, byId, el, player, plural, ranking, say } from "./dom.js";

const POLL = 400; // milliseconds
const RANKED = 5;

export class Tray {
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

  send(file, name, options) {
    const clip = new Clip(this, file, name);
    this.clips.add(clip);
    byId("clips").prepend(clip.element);
    byId("tray").hidden = false;
    clip.send(options);
  }

  // What is enrolled, or tau, has changed.
  update() { for (const clip of this.clips) clip.update(); }
  judge() { for (const clip of this.clips) clip.judge(); }

  remove(clip) {
    const focused = clip.element.contains(document.activeElement);
    this.clips.delete(clip);
    clip.element.remove();
    byId("tray").hidden = this.clips.size === 0;
    if (focused) byId(this.clips.size ? "tray-title" : "actions-title").focus();
  }
}

class Clip {
  constructor(tray, file, name) {
    Object.assign(this, { tray, file, name, id: null, told: null, gone: new AbortController() });
    this.body = el("div");
    this.element = el("article", { class: "card", "aria-label": `Clip ${name}` },
      el("div", { class: "head" }, el("h3", {}, name)), this.body);
  }

  async send(options) {
    this.wait("sending");
    const { file } = this;
    try {
      const limit = this.tray.studio.state?.limit;
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
      const told = await get(`/api/clips/${this.id}`);
      if (this.gone.signal.aborted) return;
      if (told.state === "failed") return this.fail(told.message);
      if (told.state === "ready") return this.show(told);
      this.wait("looking", told.seconds, told.total);
      await new Promise((done) => setTimeout(done, POLL));
    }
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
        button("Try again", () => this.send(this.tray.options()), { "aria-label": `Try ${this.name} again` }),
        button("Dismiss", () => this.discard(""), { "aria-label": `Dismiss ${this.name}` })));
  }

  show(told) {
    this.told = told;
    this.file = null;
    const { decision } = told;
    this.stage = el("div");
    this.verdict = el("p", { class: "verdict" });
    this.ranked = el("div");
    this.label = el("input", {
      list: "labels", maxlength: 100, autocomplete: "off", required: true,
      value: decision?.accepted ? decision.nearest : "",
    });
    const form = el("form", { submit: (event) => { event.preventDefault(); this.enroll(false); } },
      el("label", {}, "Name of the action", this.label),
      el("button", { type: "submit", class: "main" }, "Enrol"),
      button("Never accept", () => this.enroll(true), { title: "Keep it as what must never be accepted" }),
      button("Discard", () => this.discard("discarded"), { "aria-label": `Discard ${this.name}` }));
    const notes = el("ul", { class: "notes" },
      el("li", {}, `${plural(told.frames, "frame")}, ${told.seconds.toFixed(1)} s`),
      ...told.notes.map((note) => el("li", {}, note)));
    this.problem = el("p", { class: "problem", role: "alert", hidden: true });
    this.body.replaceChildren(this.stage,
      this.verdict, this.ranked, notes, form, this.problem);
    this.draw();
    this.judge();
    say(`${this.name}: ${this.verdict.textContent}`);
  }

  // The clip, and beside it, in step, an example of the action that it is nearest to.
  async draw() {
    const nearest = this.told.decision?.nearest ?? "";
    if (nearest === this.beside) return;
    this.beside = nearest;
    const shown = [{ caption: "this clip", figure: this.told.figure }];
    this.stage.replaceChildren(player(this.name, shown));
    const action = this.tray.studio.state?.actions.find((each) => each.label === nearest);
    if (!action) return;
    const figure = await get(`/api/examples/${action.examples[0].id}`).catch(() => null);
    if (figure === null || this.beside !== nearest) return;
    this.stage.replaceChildren(player(this.name, [...shown, { caption: `nearest: ${nearest}`, figure }]));
  }

  async update() {
    if (!this.told) return;
    try {
      this.told.decision = (await get(`/api/clips/${this.id}`)).decision;
      this.draw();
      this.judge();
    } catch (error) {
      this.refuse(error.message);
    }
  }

  // Words for the decision, under the tau that the slider shows.
  judge() {
    if (!this.told) return;
    const { decision } = this.told;
    this.ranked.replaceChildren();
    if (!decision) {
      this.verdict.className = "verdict none";
      this.verdict.textContent = "Nothing is enrolled to compare it with.";
      return;
    }
    const tau = this.tau(decision);
    const accepted = decision.confidence > tau && !decision.shadowed;
    const sure = `${decision.confidence.toFixed(2)} ${decision.confidence > tau ? ">" : "≤"} τ ${tau.toFixed(2)}`;
    this.verdict.className = `verdict${accepted ? " yes" : ""}`;
    const [from, to] = decision.part ?? [0, Infinity];
    const part = to - from < 0.98 * this.told.seconds ? `, from ${from.toFixed(1)} s to ${to.toFixed(1)} s` : "";
    this.verdict.textContent = accepted
      ? `Recognised: ${decision.nearest} (confidence ${sure}${part})`
      : `Rejected (nearest ${decision.nearest}, confidence ${sure}${decision.shadowed ? ", but a negative is nearer" : ""})`;
    this.ranked.append(ranking(decision.ranking.slice(0, RANKED), tau));
  }

  tau(decision) { return this.tray.studio.tau() ?? decision.tau; }

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
      const told = await ask("POST", `/api/clips/${this.id}/enroll`, { label, negative });
      const what = told.added ? "enrolled" : "was there already";
      const warned = told.warnings.length ? ` It is ${told.warnings.join(", and ")}.` : "";
      say(`${this.name} ${what} as ${negative ? "what is never accepted" : told.label}.${warned}`);
      this.tray.remove(this);
      await this.tray.studio.refresh();
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
    this.tray.remove(this);
  }
}
