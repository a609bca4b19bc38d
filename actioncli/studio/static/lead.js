// The head of the page says what comes next: a first action, a second one, then trying them live.

import { file } from "./api.js";
import { button, byId, say } from "./dom.js";

export class Lead {
  constructor(uploads) {
    this.uploads = uploads;
    this.taken = {};
  }

  update({ actions, samples }) {
    const labels = actions.filter((action) => !action.negative).map((action) => action.label);
    document.body.classList.toggle("ready", labels.length > 1);
    byId("lead-title").textContent = ["Record or drop a clip", "Record or drop a second action"][labels.length] ?? "Try it live";
    byId("lead").textContent = [
      "From one clip on, an action is recognised, and everything else is rejected. A clip shows one person, " +
      "whole, doing one action once; a video from your phone will do.",
      `${labels[0]} is known. With two actions you can try them live.`,
    ][labels.length] ?? `Do ${listed(labels)} before the camera. Record or drop another clip to add to it.`;
    // Who has actions of their own needs no examples.
    byId("samples").hidden = labels.some((label) => !(label in samples));
    if (byId("samples").children.length === 1)
      byId("samples").append(...Object.keys(samples).map((action) => button(action, () => this.take(action, samples[action]))));
  }

  // Each time another performer's.
  async take(action, performers) {
    const turn = (this.taken[action] = (this.taken[action] ?? -1) + 1);
    const performer = performers[turn % performers.length];
    try {
      this.uploads.send(await file(`/api/samples/${action}/${performer}`), `${action} ${performer}.npz`, {}, action);
    } catch (error) {
      say(error.message);
    }
  }
}

const MOST = 4; // actions that are listed by name

function listed(labels) {
  const some = labels.slice(0, MOST);
  if (labels.length > MOST) return `${some.join(", ")} or another action`;
  return `${some.slice(0, -1).join(", ")} or ${some.at(-1)}`;
}
