// tau on a slider: what each position would accept and reject, as it was measured.

import { ask, get } from "./api.js";
import { byId, el, say, svg } from "./dom.js";

const POLL = 500; // milliseconds
const KINDS = [
  ["false_accepts", "False accepts", "clips that show none of your actions", "s1"],
  ["false_rejects", "False rejects", "of your own examples", "s0"],
];

export class Threshold {
  constructor(studio) {
    this.studio = studio;
    this.slider = byId("tau");
    this.measured = null;
    this.touched = false;
    this.asking = 0;
    this.slider.addEventListener("input", () => { this.touched = true; this.show(); studio.tauChanged(); });
    byId("keep").addEventListener("click", () => this.keep(this.value));
    byId("reset").addEventListener("click", () => this.keep(null));
    byId("recommended").addEventListener("click", () => this.move(this.measured.recommended));
  }

  get value() { return Number(this.slider.value) / 100; }

  // The tau that is tried; null while the one in use is.
  get trying() { return this.touched ? this.value : null; }

  move(tau) {
    this.slider.value = Math.round(100 * tau);
    this.touched = true;
    this.show();
    this.studio.tauChanged();
  }

  update(state) {
    this.state = state;
    byId("threshold").hidden = !state.actions.some((action) => !action.negative);
    if (!this.touched) this.slider.value = Math.round(100 * state.tau);
    this.show();
    this.measure();
  }

  async keep(tau) {
    try {
      await ask("PUT", "/api/tau", { tau });
      this.touched = false;
      say(tau === null ? "τ is 0.50 again." : `τ ${tau.toFixed(2)} is kept; classify and watch use it, too.`);
    } catch (error) {
      say(error.message);
    }
    await this.studio.refresh();
  }

  async measure() {
    const mine = ++this.asking;
    try {
      while (mine === this.asking) {
        const answer = await get("/api/measurement");
        if (mine !== this.asking) return;
        this.measured = answer.state === "measured" ? answer : null;
        // Rounded up: what is recommended is the smallest that holds.
        if (answer.recommended) answer.recommended = Math.ceil(100 * answer.recommended - 1e-6) / 100;
        this.share = answer.share ?? 0;
        this.show();
        if (answer.state !== "measuring") return;
        await new Promise((done) => setTimeout(done, POLL));
      }
    } catch (error) {
      byId("words").replaceChildren(el("p", { class: "problem" }, error.message));
    }
  }

  show() {
    if (!this.state) return;
    const tau = this.value.toFixed(2);
    byId("tau-said").value = tau;
    const { kept, automatic, own } = this.state;
    const inUse = this.state.tau.toFixed(2);
    byId("kept").textContent = `In use: ${inUse}${automatic ? ", chosen by what you enrolled" : kept ? "" : ", as nothing else was kept"}.` +
      (own ? ` ${own} of the actions have a τ of their own, which keeping another replaces.` : "");
    byId("keep").textContent = `Keep τ ${tau}`;
    byId("reset").hidden = !kept;
    const recommended = this.measured?.recommended ?? null;
    byId("recommended").hidden = recommended === null;
    if (recommended !== null) byId("recommended").textContent = `Try the recommended ${recommended.toFixed(2)}`;
    if (!this.measured) {
      this.slider.setAttribute("aria-valuetext", tau);
      byId("rates").replaceChildren();
      byId("words").replaceChildren(el("p", { class: "muted" }, "Counting false alarms …"),
        el("progress", { max: 1, value: this.share, "aria-label": "Counting false alarms" }));
      return;
    }
    const rates = this.measured.rates[Number(this.slider.value)];
    const words = [alarms(rates.false_accepts), missed(rates.false_rejects)];
    byId("words").replaceChildren(...words.map((each) => el("p", {}, each)));
    this.slider.setAttribute("aria-valuetext", `${tau}: ${words.join(" ")}`);
    const rows = KINDS.map(([key, name, of]) => el("tr", {},
      el("th", { scope: "row" }, name),
      el("td", { class: "text", "data-rate": key }, rates[key].of ? `${count(rates[key])} ${of}` : count(rates[key])),
      el("td", {}, rates[key].of ? `${percent(rates[key].low)}–${percent(rates[key].high)} %` : "")));
    const head = el("thead", {}, el("tr", {}, el("th", { scope: "col", class: "text" }, "At this τ"),
      el("th", { scope: "col", class: "text" }, "counted"), el("th", { scope: "col" }, "95 % interval")));
    const notes = this.measured.notes.length
      ? el("ul", { class: "notes" }, ...this.measured.notes.map((note) => el("li", {}, note)))
      : null;
    byId("rates").replaceChildren(
      el("div", {}, el("table", { class: "rates" }, head, el("tbody", {}, ...rows)), notes), this.curve());
  }

  // Both shares over tau, and where the slider stands.
  curve() {
    const { rates } = this.measured;
    const x = (step) => 42 + (step / (rates.length - 1)) * 312;
    const y = (share) => 100 - share * 90;
    const lines = [];
    const legend = [];
    for (const [key, name, , colour] of KINDS) {
      if (!rates[0][key].of) continue;
      const points = rates.map((rate, step) => `${x(step)},${y(rate[key].count / rate[key].of)}`).join(" ");
      const line = svg("polyline", { points, fill: "none", "stroke-width": 2 });
      line.style.stroke = `var(--${colour})`;
      if (key === "false_rejects") line.setAttribute("stroke-dasharray", "5 3");
      lines.push(line);
      legend.push(`${name.toLowerCase()} ${key === "false_rejects" ? "dashed" : "solid"}`);
    }
    const at = x(Number(this.slider.value));
    const rule = svg("line", { x1: at, x2: at, y1: 6, y2: 104, "stroke-width": 1.5 });
    rule.style.stroke = "var(--ink)";
    const ground = [0, 0.5, 1].map((share) => {
      const line = svg("line", { x1: 42, x2: 354, y1: y(share), y2: y(share) });
      line.style.stroke = "var(--line)";
      return line;
    });
    const words = [[0, "0 %"], [1, "100 %"]].map(([share, text]) =>
      svg("text", { x: 0, y: y(share) + 4, "font-size": 10 }, text));
    const marks = [0, 0.5, 1].map((tau) =>
      svg("text", { x: x(100 * tau), y: 116, "text-anchor": "middle" }, `τ ${tau}`));
    return svg("svg", {
      class: "curve", viewBox: "0 0 372 122", role: "img",
      "aria-label": `Shares over τ, ${legend.join(", ")}`,
    }, ...ground, ...words, ...marks, ...lines, rule);
  }
}

const NUMBERS = ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"];
const alarm = (count) => `${NUMBERS[count] ?? count} false alarm${count > 1 ? "s" : ""}`;

// Of few clips each is told: "in a hundred" would say more than was counted.
function alarms({ count, of }) {
  if (!of) return "How many false alarms there would be cannot be told yet.";
  if (count && of >= 50) return `About ${alarm(Math.max(Math.round((100 * count) / of), 1))} in a hundred other clips.`;
  const counted = alarm(count);
  return `${counted[0].toUpperCase()}${counted.slice(1)} in ${of} other clips.`;
}

function missed({ count, of }) {
  if (!of) return "How many of your own it would miss is told once an action has two examples.";
  return `${count || "None"} of your ${of} own examples would be missed.`;
}

const percent = (share) => Math.round(100 * share);
const count = (rate) => (rate.of ? `${rate.count} of ${rate.of}` : "cannot be told yet");
