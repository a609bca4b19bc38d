// The support set: a card for each action, with its examples in motion.

import { ask, get } from "./api.js";
import { button, byId, el, player, plural, say } from "./dom.js";

const SHOWN = 4; // examples that are drawn until somebody asks for all

export class Actions {
  constructor(studio) {
    this.studio = studio;
    this.cards = new Map();
  }

  update({ actions }) {
    const here = byId("actions");
    byId("mine").hidden = actions.length === 0;
    const labels = actions.filter((action) => !action.negative).map((action) => action.label);
    byId("labels").replaceChildren(...labels.map((label) => el("option", { value: label })));
    const before = this.cards;
    this.cards = new Map();
    for (const action of [...actions].sort((a, b) => a.negative - b.negative)) {
      const content = JSON.stringify(action);
      const old = before.get(action.label);
      const card = old?.content === content ? old : { content, element: this.card(action) };
      this.cards.set(action.label, card);
      if (old && old !== card && old.element.contains(document.activeElement)) byId("actions-title").focus();
    }
    const wanted = [...this.cards.values()].map((card) => card.element);
    for (const child of [...here.children]) if (!wanted.includes(child)) child.remove();
    wanted.forEach((element, place) => {
      if (here.children[place] !== element) here.insertBefore(element, here.children[place] ?? null);
    });
  }

  card(action) {
    const { label, negative, examples } = action;
    const seconds = examples.reduce((sum, example) => sum + example.seconds, 0);
    const stage = el("div");
    const element = el("article", { class: "card", "aria-label": label },
      el("div", { class: "head" },
        el("div", {}, el("h3", {}, label),
          el("span", { class: "muted" }, `${negative ? "never accepted, " : ""}${plural(examples.length, "example")}, ${seconds.toFixed(1)} s`)),
        el("div", { class: "row" },
          negative ? null : button("Rename", () => this.rename(label), { class: "small", "aria-label": `Rename ${label}` }),
          button("Delete", () => this.remove(label, examples.length), { class: "small", "aria-label": `Delete ${label}` }))),
      stage);
    this.draw(stage, action, examples.slice(0, SHOWN));
    if (examples.length > SHOWN) {
      element.append(button(`Show all ${examples.length}`, (event) => {
        event.target.remove();
        this.draw(stage, action, examples);
      }, { class: "small", "aria-label": `Show all ${examples.length} examples of ${label}` }));
    }
    return element;
  }

  async draw(stage, { label, examples: all }, examples) {
    try {
      const figures = await Promise.all(examples.map((example) => get(`/api/examples/${example.id}`)));
      stage.replaceChildren(player(label, examples.map((example, place) => ({
        figure: figures[place],
        caption: el("span", {}, example.source || `example ${example.id}`, el("br"),
          all.length > 1
            ? button("Delete", () => this.removeExample(label, example), {
              class: "small", "aria-label": `Delete example ${example.id} of ${label}`,
            })
            : null),
      }))));
    } catch (error) {
      // Removed by somebody else meanwhile: the next state tells.
      if (error.status !== 404) stage.replaceChildren(el("p", { class: "problem" }, error.message));
    }
  }

  async remove(label, count) {
    const what = count === 1 ? "its only example" : `all its ${count} examples`;
    if (await question(`Delete ${label} with ${what}? This cannot be undone.`, "Delete") === null) return;
    await this.attempt("DELETE", "/api/actions", { label }, `${label} deleted.`);
  }

  async removeExample(label, example) {
    if (await question(`Delete example ${example.id} of ${label}? This cannot be undone.`, "Delete") === null) return;
    await this.attempt("DELETE", `/api/examples/${example.id}`, { label }, `Example ${example.id} of ${label} deleted.`);
  }

  async rename(label) {
    const name = await question(`Another name for ${label}`, "Rename", label);
    if (name === null || name === label) return;
    await this.attempt("PATCH", "/api/actions", { label, new: name }, `${label} is now ${name}.`);
  }

  async attempt(method, path, document, message) {
    try {
      await ask(method, path, document);
      say(message);
    } catch (error) {
      say(error.message);
    }
    await this.studio.refresh();
  }
}

// Ask in a dialogue: null where it is cancelled, else what was typed ("" where nothing is asked for).
export function question(text, yes, value = null) {
  const dialog = byId("ask"), answer = byId("answer");
  byId("question").textContent = text;
  byId("yes").textContent = yes;
  byId("answer-label").hidden = value === null;
  answer.value = value ?? "";
  dialog.showModal();
  if (value === null) byId("no").focus(); else answer.select();
  return new Promise((resolve) => {
    const done = new AbortController();
    const end = (result) => { done.abort(); dialog.close(); resolve(result); };
    const on = (element, type, then) => element.addEventListener(type, then, { signal: done.signal });
    on(dialog.querySelector("form"), "submit", (event) => { event.preventDefault(); end(answer.value.trim()); });
    on(byId("no"), "click", () => end(null));
    on(dialog, "cancel", () => end(null));
  });
}
