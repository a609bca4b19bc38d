// One recorded clip after the other, decided on by a click or a key.

import { ask, get } from "./api.js";
import { byId, el, player, plural, say } from "./dom.js";

const KEYS = { e: "enroll", o: "other", n: "negative", d: "delete", s: "skip" };

let waiting = [];
let place = 0;
let busy = false;

async function load() {
  const answer = await get("/api/waiting");
  byId("folder").textContent = answer.folder;
  byId("store").textContent = answer.store;
  byId("labels").replaceChildren(...answer.labels.map((label) => el("option", { value: label })));
  waiting = answer.clips;
  place = 0;
  await show();
}

async function show() {
  const clip = waiting[place];
  byId("clip").hidden = !clip;
  byId("done").hidden = Boolean(clip);
  byId("again").hidden = Boolean(clip) || waiting.length === 0;
  if (!clip) {
    byId("done").textContent = waiting.length
      ? `That was the last one; ${plural(waiting.length, "clip")} skipped.` : "Nothing waits for review.";
    return;
  }
  byId("title").textContent = `${place + 1} of ${waiting.length}: ${clip.event ? "event" : "near miss"}, ${clip.label}`;
  byId("what").textContent = `Confidence ${clip.confidence.toFixed(2)}, τ ${clip.tau.toFixed(2)}; ${clip.source}, ` +
    `${clip.start.toFixed(1)} s to ${clip.end.toFixed(1)} s.`;
  byId("label").value = clip.label;
  byId("stage").replaceChildren();
  byId("clip").focus();
  try {
    const { figure, example } = await get(`/api/waiting/${encodeURIComponent(clip.file)}`);
    if (clip !== waiting[place]) return;
    const shown = [{ caption: "what was recorded", figure }];
    if (example) shown.push({ caption: `example of ${clip.label}`, figure: example });
    byId("stage").replaceChildren(player(clip.file, shown));
  } catch (error) {
    byId("stage").replaceChildren(el("p", { class: "problem" }, error.message));
  }
}

async function decide(what) {
  const clip = waiting[place];
  if (!clip || busy) return;
  if (what === "other") {
    byId("label").focus();
    byId("label").select();
    return;
  }
  problem("");
  if (what === "skip") {
    place++;
    await show();
    return;
  }
  busy = true;
  try {
    const label = byId("label").value.trim();
    const answer = await ask("POST", `/api/waiting/${encodeURIComponent(clip.file)}`, { decision: what, label });
    say({
      enroll: `${clip.file} enrolled as ${label}.${answer.warnings.length ? ` It is ${answer.warnings.join(", and ")}.` : ""}`,
      negative: `${clip.file} is never accepted.`,
      delete: `${clip.file} deleted.`,
    }[what]);
    waiting.splice(place, 1);
  } catch (error) {
    problem(error.message);
    return;
  } finally {
    busy = false; // the next clip can be decided on while its picture is still on the way
  }
  await show();
}

function problem(text) {
  byId("problem").textContent = text;
  byId("problem").hidden = !text;
}

byId("decide").addEventListener("submit", (event) => { event.preventDefault(); decide("enroll"); });
for (const what of ["other", "negative", "delete", "skip"]) byId(what).addEventListener("click", () => decide(what));
byId("again").addEventListener("click", () => load().catch((error) => problem(error.message)));
addEventListener("keydown", (event) => {
  const typing = event.target.matches("input:not([type=range]), select, textarea");
  if (typing || event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
  const what = KEYS[event.key.toLowerCase()];
  if (!what) return;
  event.preventDefault();
  decide(what);
});
load().catch((error) => problem(error.message));
