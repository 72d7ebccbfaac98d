// Places on the surface: chosen with the pointer or the keyboard, and marked on every panel.

import { h } from "./dom.js";

// Pixels within which the nearest vertex in front is meant.
const NEAR = 14;

export class Places {
  constructor(viewer) {
    this.viewer = viewer;
    this.marks = [];
    this.prompt = h("p", { class: "prompt", hidden: true, role: "status" });
    this.aim = h("span", { class: "aim", hidden: true, "aria-hidden": "true" });
    const { canvas } = viewer;
    let from = null;
    canvas.addEventListener("pointerdown", (event) => (from = [event.clientX, event.clientY]));
    canvas.addEventListener("pointerup", (event) => {
      // A drag turns the surface.
      const isClick = from && Math.hypot(event.clientX - from[0], event.clientY - from[1]) < 5;
      if (this.done && isClick) this.finish(this.at(event.clientX, event.clientY));
    });
    canvas.addEventListener("keydown", (event) => {
      if (!this.done || !["Enter", "Escape"].includes(event.key)) return;
      event.preventDefault();
      const box = this.panels()[0].element.getBoundingClientRect();
      this.finish(event.key === "Enter" ? this.at(box.left + box.width / 2, box.top + box.height / 2) : null);
    });
  }

  panels() {
    return this.viewer.stage.panels.filter(({ isShown, number }) => isShown && number === 0);
  }

  choose(words, done) {
    this.viewer.play(false);
    this.done = done;
    this.prompt.textContent = `${words}: click on the surface, or turn it and press Enter`;
    this.prompt.hidden = this.aim.hidden = false;
    this.viewer.canvas.classList.add("placing-here");
    this.panels()[0].element.append(this.aim);
    this.viewer.canvas.focus({ preventScroll: true });
    this.viewer.canvas.scrollIntoView({ block: "center", behavior: "auto" });
  }

  finish(vertex) {
    const { done } = this;
    this.done = null;
    this.prompt.hidden = this.aim.hidden = true;
    this.viewer.canvas.classList.remove("placing-here");
    done(vertex);
  }

  // The vertex under a point of the page: of those near it the one in front.
  at(x, y) {
    const panel = this.panels().find(({ element }) => {
      const box = element.getBoundingClientRect();
      return x >= box.left && x <= box.right && y >= box.top && y <= box.bottom;
    });
    if (!panel) return null;
    const { stage } = this.viewer;
    const box = panel.element.getBoundingClientRect();
    const project = stage.projection(panel, box);
    const points = this.positions(panel);
    let [best, least, front] = [null, Infinity, Infinity];
    for (let v = 0, i = 0; v < points.length / 3; v++, i += 3) {
      const [px, py, depth] = project(points[i], points[i + 1], points[i + 2]);
      const away = Math.hypot(px + box.left - x, py + box.top - y);
      if (away > 60) continue;
      const isNear = away < NEAR;
      // Near ones by their depth, else the nearest of all.
      if (isNear ? depth < front : front === Infinity && away < least) {
        best = v;
        if (isNear) front = depth;
        least = away;
      }
    }
    return best;
  }

  positions({ surface, number }) {
    const motion = this.viewer.motions[number];
    if (!surface.card) return surface.points;
    const out = new Float32Array(3 * motion.nVertices);
    return motion.positions(this.viewer.place(number), this.viewer.gains[number], out);
  }

  // `landmarks`: by name a vertex; points of space have no vertex to be marked at.
  show(landmarks) {
    for (const { element } of this.marks) element.remove();
    this.marks = this.panels().flatMap((panel) =>
      Object.entries(landmarks).filter(([, value]) => Number.isInteger(value)).map(([name, vertex]) => {
        const element = h("span", { class: `place-mark ${name}`, "aria-hidden": "true" }, h("span", {}, name.replace("_", " ")));
        panel.element.append(element);
        return { element, vertex, panel };
      }));
    this.viewer.wish();
  }

  move() {
    for (const { element, vertex, panel } of this.marks) {
      const box = panel.element.getBoundingClientRect();
      const points = this.positions(panel);
      const [x, y] = this.viewer.stage.projection(panel, box)(points[3 * vertex], points[3 * vertex + 1], points[3 * vertex + 2]);
      element.style.left = `${x}px`;
      element.style.top = `${y}px`;
    }
  }
}
