// The studio: what is enrolled is asked for again and again, for other pages and commands change it too.

import { Actions } from "./actions.js";
import { download, get } from "./api.js";
import { Camera } from "./camera.js";
import { byId, el, say } from "./dom.js";
import { Lead } from "./lead.js";
import { Threshold } from "./threshold.js";
import { Uploads } from "./uploads.js";

const POLL = 2000; // milliseconds

const studio = {
  state: null,
  tau: () => threshold.trying,
  tauChanged() { uploads.judge(); camera.tauChanged(); },
  async refresh() {
    try {
      const answer = await get(`/api/state?version=${encodeURIComponent(this.state?.version ?? "")}`);
      byId("lost").hidden = true;
      if (!answer.actions) return;
      const first = this.state === null;
      this.state = answer;
      byId("store").textContent = answer.store;
      if (byId("layouts").length === 1) byId("layouts").append(...answer.layouts.map((name) => el("option", {}, name)));
      lead.update(answer);
      actions.update(answer);
      threshold.update(answer);
      uploads.update();
      // Who names a camera wants to see what it shows.
      if (first && answer.source && answer.actions.some((action) => !action.negative)) camera.start();
    } catch (error) {
      byId("lost").textContent = error.message;
      byId("lost").hidden = false;
    }
  },
};
const uploads = new Uploads(studio);
const lead = new Lead(uploads);
const camera = new Camera(studio, uploads);
const actions = new Actions(studio);
const threshold = new Threshold(studio);

byId("export").addEventListener("click", () =>
  download("/api/export", "actions.safetensors").catch((error) => say(error.message)));

async function follow() {
  if (!document.hidden) await studio.refresh();
  setTimeout(follow, POLL);
}
document.addEventListener("visibilitychange", () => { if (!document.hidden) studio.refresh(); });
follow();
