"use strict";
// Skeletons that play in step. A .player holds a <figure> with its caption for each of them, and
// gets canvases, which share one moment and one view, and controls here. A page's own player has the
// page's list of figures (id="figures"); one that gets its figures later calls skeletons.mount.
(() => {
  const HEAD = 0.1; // metres
  const FRONT = { yaw: 0.35, pitch: 0.12 };
  const STEP = 0.12; // radians a key press turns

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const unpacked = (figure) => ({
    ...figure,
    points: new Int16Array(bytes(figure.points).buffer), // millimetres
    sure: bytes(figure.sure),
  });

  // The frame, a fraction, that a figure shows at a share of the way through.
  function frameAt(figure, share) {
    if (!figure.clock) return share * (figure.frames - 1);
    const at = share * (figure.clock.length - 1);
    const before = Math.min(Math.floor(at), figure.clock.length - 2);
    return figure.clock[before] + (at - before) * (figure.clock[before + 1] - figure.clock[before]);
  }

  function pose(figure, share) {
    const at = frameAt(figure, share);
    const before = Math.min(Math.floor(at), Math.max(figure.frames - 2, 0));
    const after = Math.min(before + 1, figure.frames - 1);
    const part = at - before;
    const p = figure.points;
    const size = 3 * figure.joints;
    return {
      frame: Math.min(Math.round(at), figure.frames - 1),
      xyz: Float32Array.from({ length: size }, (_, i) =>
        (p[before * size + i] * (1 - part) + p[after * size + i] * part) / 1000),
    };
  }

  function draw(canvas, figure, share, view, box) {
    const side = Math.max(1, Math.round(canvas.clientWidth * devicePixelRatio));
    if (canvas.width !== side) canvas.width = canvas.height = side;
    const style = getComputedStyle(canvas);
    const colour = (name) => style.getPropertyValue("--" + name);
    const g = canvas.getContext("2d");
    const scale = (0.84 * side) / box;
    const width = side / 75;
    const [sinYaw, cosYaw] = [Math.sin(view.yaw), Math.cos(view.yaw)];
    const [sinPitch, cosPitch] = [Math.sin(view.pitch), Math.cos(view.pitch)];
    // With y up and z away from the viewer, x points to the left of the picture.
    const project = (x, y, z) => {
      const away = z * cosYaw - x * sinYaw;
      return [
        side / 2 + scale * (-x * cosYaw - z * sinYaw),
        0.9 * side - scale * (y * cosPitch + away * sinPitch),
        away,
      ];
    };
    const { frame, xyz } = pose(figure, share);
    g.clearRect(0, 0, side, side);
    g.lineCap = "round";
    g.strokeStyle = colour("ground");
    g.lineWidth = side / 400;
    for (let line = -2; line <= 2; line++) {
      for (const [a, b] of [[[line, -2], [line, 2]], [[-2, line], [2, line]]]) {
        const [x1, y1] = project(a[0] * box / 5, 0, a[1] * box / 5);
        const [x2, y2] = project(b[0] * box / 5, 0, b[1] * box / 5);
        g.beginPath(); g.moveTo(x1, y1); g.lineTo(x2, y2); g.stroke();
      }
    }
    const flat = Array.from({ length: figure.joints }, (_, joint) =>
      project(xyz[3 * joint], xyz[3 * joint + 1], xyz[3 * joint + 2]));
    const sure = (joint) => figure.sure[frame * figure.joints + joint] === 1;
    // What is farther away is painted first.
    const bones = [...figure.bones].sort((a, b) =>
      flat[b[0]][2] + flat[b[1]][2] - flat[a[0]][2] - flat[a[1]][2]);
    for (const [a, b, part, share] of bones) {
      g.strokeStyle = colour(part);
      g.lineWidth = share * width;
      g.setLineDash(sure(a) && sure(b) ? [] : [width / 4, 2 * width]);
      g.beginPath(); g.moveTo(flat[a][0], flat[a][1]); g.lineTo(flat[b][0], flat[b][1]); g.stroke();
    }
    g.setLineDash([]);
    const ring = (joint, radius, line, name) => {
      g.beginPath(); g.arc(flat[joint][0], flat[joint][1], radius, 0, 2 * Math.PI);
      g.fillStyle = colour("panel"); g.fill();
      g.strokeStyle = colour(name); g.lineWidth = line; g.stroke();
    };
    if (figure.head !== null) ring(figure.head, scale * HEAD, 0.6 * width, "middle");
    for (let joint = 0; joint < figure.joints; joint++) {
      const glow = figure.glow && figure.glow[joint];
      if (glow) {
        // The area of the mark is the joint's share of the distance.
        g.globalAlpha = 0.55;
        g.beginPath(); g.arc(flat[joint][0], flat[joint][1], side * 0.12 * Math.sqrt(glow), 0, 2 * Math.PI);
        g.fillStyle = colour("mark"); g.fill();
        g.globalAlpha = 1;
      }
      if (!sure(joint)) ring(joint, 0.9 * width, 0.4 * width, "muted");
    }
  }

  function add(parent, tag, attributes, text = "") {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    element.textContent = text;
    parent.append(element);
    return element;
  }

  // Bring a .player to life. It rests once it has left the page.
  // name: what the controls say that they control; figures: one for each <figure>, as `playable` has it.
  function mount(player, name, figures) {
    const shown = figures.map(unpacked);
    const panels = [...player.querySelectorAll("figure")];
    const canvases = panels.map((panel, place) => add(panel, "canvas", {
      width: 300, height: 300, tabindex: 0, role: "img",
      "aria-label": `Skeleton, ${name}, ${place + 1} of ${panels.length}; arrow keys turn it, space plays`,
    }));
    panels.forEach((panel, place) => panel.prepend(canvases[place]));
    const controls = add(player, "div", { class: "controls" });
    const play = add(controls, "button", { type: "button", class: "play", "aria-label": `Play or pause: ${name}` }, "Play");
    const scrub = add(controls, "input", { class: "scrub", type: "range", min: 0, max: 1000, "aria-label": `Moment: ${name}` });
    const said = add(controls, "output", { class: "said", "aria-live": "off" });
    const front = add(controls, "button", { type: "button", class: "front", "aria-label": `Turn to the front: ${name}` }, "Front");
    const followers = document.querySelectorAll(".cursor");
    const seconds = Math.max(1, ...shown.map((figure) => figure.seconds));
    const box = Math.max(...shown.map((figure) => figure.box));
    const view = { ...FRONT };
    let share = shown[0].opens, playing = false, last = 0;

    function show() {
      canvases.forEach((canvas, i) => draw(canvas, shown[i], share, view, box));
      scrub.value = String(Math.round(1000 * share));
      said.value = Math.round(100 * share) + " %";
      for (const line of followers) line.setAttribute("transform", `translate(${share * line.dataset.span} 0)`);
    }
    function tick(now) {
      if (!playing || !player.isConnected) return;
      share += (now - last) / 1000 / seconds;
      last = now;
      if (share >= 1) share -= Math.floor(share);
      show();
      requestAnimationFrame(tick);
    }
    function run(on) {
      playing = on;
      play.textContent = on ? "Pause" : "Play";
      last = performance.now();
      if (on) requestAnimationFrame(tick);
    }
    play.addEventListener("click", () => run(!playing));
    scrub.addEventListener("input", () => { run(false); share = scrub.value / 1000; show(); });
    front.addEventListener("click", () => { Object.assign(view, FRONT); show(); });
    function turn(yaw, pitch) {
      view.yaw += yaw;
      view.pitch = Math.max(-0.2, Math.min(1.5, view.pitch + pitch));
      show();
    }
    for (const canvas of canvases) {
      canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
      canvas.addEventListener("pointermove", (event) => {
        if (canvas.hasPointerCapture(event.pointerId)) turn(event.movementX / 100, event.movementY / 100);
      });
      canvas.addEventListener("keydown", (event) => {
        const turns = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] };
        if (turns[event.key]) turn(...turns[event.key]);
        else if (event.key === " ") run(!playing);
        else if (event.key === "Home") { Object.assign(view, FRONT); show(); }
        else return;
        event.preventDefault();
      });
    }
    new ResizeObserver(show).observe(canvases[0]);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
    addEventListener("beforeprint", show);
    show();
  }

  const source = document.getElementById("figures");
  if (source) {
    const player = document.querySelector(".player");
    mount(player, player.dataset.name, JSON.parse(source.textContent));
  }
  globalThis.skeletons = { mount };
})();
