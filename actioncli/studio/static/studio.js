// The studio: what is enrolled is asked for again and again, for other pages and commands change it too.

import { Actions } from "./actions.js";
import { get } from "./api.js";
import { Camera } from "./camera.js";
import { byId, el } from "./dom.js";
import { Threshold } from "./threshold.js";
import { Tray } from "./tray.js";

const POLL = 2000; // milliseconds

// The token has become a cookie; it must not stay in the address bar and the history.
history.replaceState(null, "", "/");

const studio = {
  state: null,
  tau: () => threshold.trying,
  tauChanged() { tray.judge(); camera.tauChanged(); },
  async refresh() {
    try {
      const told = await get(`/api/state?version=${encodeURIComponent(this.state?.version ?? "")}`);
      byId("lost").hidden = true;
      if (!told.actions) return;
      this.state = told;
      byId("store").textContent = told.store;
      if (byId("layouts").length === 1) byId("layouts").append(...told.layouts.map((name) => el("option", {}, name)));
      actions.update(told);
      threshold.update(told);
      tray.update();
    } catch (error) {
      byId("lost").textContent = error.message;
      byId("lost").hidden = false;
    }
  },
};
const tray = new Tray(studio);
const camera = new Camera(studio, tray);
const actions = new Actions(studio);
const threshold = new Threshold(studio);

async function follow() {
  if (!document.hidden) await studio.refresh();
  setTimeout(follow, POLL);
}
document.addEventListener("visibilitychange", () => { if (!document.hidden) studio.refresh(); });
follow();
