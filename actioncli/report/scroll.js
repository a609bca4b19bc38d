"use strict";
// What is wider than the page says so. The documentation's site has this script, too.
addEventListener("load", () => {
  for (const area of document.querySelectorAll(".scroll, .md-typeset__scrollwrap")) {
    const hint = document.createElement("p");
    hint.className = "sideways";
    hint.textContent = "The table goes on: scroll sideways →";
    area.before(hint);
    const told = () => { hint.hidden = area.scrollWidth <= area.clientWidth + 1; };
    new ResizeObserver(told).observe(area);
    told();
  }
});
