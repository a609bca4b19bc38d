// Elements, figures and words that all pages need. Text is only ever set as text.

const SVG = "http://www.w3.org/2000/svg";

export const byId = (id) => document.getElementById(id);

// An element; attributes that are functions listen, those that are true stand without a value.
export function el(tag, attributes = {}, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

export function svg(tag, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, tag), attributes, children);
}

function filled(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null));
  return element;
}

export const button = (text, click, attributes = {}) =>
  el("button", { type: "button", click, ...attributes }, text);

// Figures side by side that play in step: [{ caption, figure }], a caption being text or an element.
export function player(name, shown) {
  const panels = shown.map(({ caption }) => el("figure", {}, el("figcaption", {}, caption)));
  const element = el("div", { class: "player" }, el("div", { class: "stage" }, ...panels));
  globalThis.skeletons.mount(element, name, shown.map(({ figure }) => figure));
  return element;
}

// Actions with their confidence, a bar each, and a line at tau.
export function ranking(ranked, tau) {
  const rows = ranked.map(({ label, confidence }) => {
    const bar = el("span"), line = el("i");
    bar.style.width = `${100 * (confidence ?? 0)}%`;
    line.style.left = `${100 * tau}%`;
    return el("tr", { class: confidence > tau ? "" : "low" },
      el("th", { scope: "row" }, label),
      el("td", { class: "bar" }, el("div", {}, bar, line)),
      el("td", {}, confidence === null ? "–" : confidence.toFixed(2)));
  });
  return el("table", { class: "bars" }, el("tbody", {}, ...rows));
}

export const plural = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;

// Tell what happened to who looks and to who listens.
export function say(text) {
  byId("said").textContent = text;
}
