// Curves over time, and the bull's-eye.

import { h, numeral, svg } from "./dom.js";
import { css, GRADIENT } from "./viridis.js";

const [W, H] = [360, 190];
const [LEFT, RIGHT, TOP, BOTTOM] = [46, 12, 10, 34];

function ticks(low, high, n = 4) {
  const raw = (high - low) / n || 1;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= raw * 0.999) || raw;
  const out = [];
  for (let t = Math.ceil(low / step - 1e-9) * step; t <= high + 1e-9 * step; t += step)
    out.push(Math.abs(t) < step * 1e-9 ? 0 : t);
  return out;
}

const tickText = (t, all) => {
  const step = all.length > 1 ? Math.abs(all[1] - all[0]) : 1;
  if (Math.abs(t) >= 1e5 || (t && Math.abs(t) < 1e-4)) return t.toExponential(0);
  return t.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
};

// A chart of curves, each { points, className, area }, over `at`; a click moves the time there.
export class CurveChart {
  constructor({ title, note, at, xLabel, yLabel, curves, marks = [], legend = [], fromZero, seek }) {
    this.at = at;
    this.seek = seek;
    const all = curves.flatMap((c) => c.points).filter(Number.isFinite);
    let [low, high] = [Math.min(...all), Math.max(...all)];
    if (fromZero) low = Math.min(low, 0);
    if (!(high > low)) [low, high] = [low - 1, high + 1];
    const pad = (marks.length ? 0.17 : 0.06) * (high - low);
    [low, high] = [fromZero && low === 0 ? 0 : low - pad, high + pad];
    const [first, last] = [at[0], at[at.length - 1] > at[0] ? at[at.length - 1] : at[0] + 1];
    this.x = (t) => LEFT + ((t - first) / (last - first)) * (W - LEFT - RIGHT);
    this.y = (v) => H - BOTTOM - ((v - low) / (high - low)) * (H - TOP - BOTTOM);
    const across = ticks(first, last, 5);
    const up = ticks(low, high, 4);
    const path = (points) =>
      points.map((v, i) => `${i ? "L" : "M"}${this.x(at[i]).toFixed(1)} ${this.y(v).toFixed(1)}`).join("");
    this.paths = curves.map((c) =>
      c.area
        ? svg("path", {
            class: c.className,
            d: `${path(c.points)}L${this.x(at[at.length - 1])} ${this.y(low)}L${this.x(at[0])} ${this.y(low)}Z`,
          })
        : svg("path", { class: `curve ${c.className}`, d: path(c.points) }),
    );
    this.cursor = svg("line", { class: "cursor", y1: TOP, y2: H - BOTTOM });
    this.picture = svg(
      "svg",
      { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": `${title}. ${note || ""}` },
      up.map((v) => svg("line", { class: "grid", x1: LEFT, x2: W - RIGHT, y1: this.y(v), y2: this.y(v) })),
      up.map((v) =>
        svg("text", { class: "tick", x: LEFT - 6, y: this.y(v) + 4, "text-anchor": "end" }, tickText(v, up)),
      ),
      across.map((t) =>
        svg("text", { class: "tick", x: this.x(t), y: H - BOTTOM + 15, "text-anchor": "middle" }, tickText(t, across)),
      ),
      svg("text", { class: "axis", x: (LEFT + W - RIGHT) / 2, y: H - 3, "text-anchor": "middle" }, xLabel),
      svg("text", { class: "axis", x: -(H - BOTTOM + TOP) / 2, y: 11, "text-anchor": "middle", transform: "rotate(-90)" }, yLabel),
      this.paths,
      marks.map(({ at: t, value, text, above }) => [
        svg("circle", { class: "mark", cx: this.x(t), cy: this.y(value), r: 3.5 }),
        svg("text", {
          class: "tick strong",
          x: Math.min(Math.max(this.x(t), LEFT + 24), W - RIGHT - 24),
          y: this.y(value) + (above ? -8 : 16),
          "text-anchor": "middle",
        }, text),
      ]),
      this.cursor,
    );
    this.picture.addEventListener("pointerdown", (event) => this.point(event));
    this.picture.addEventListener("pointermove", (event) => event.buttons && this.point(event));
    this.span = [first, last];
    this.element = h(
      "figure",
      { class: "chart" },
      h("figcaption", {}, h("h3", {}, title), note ? h("p", { class: "note" }, note) : null),
      this.picture,
      legend.length
        ? h("ul", { class: "legend" }, legend.map(([className, text]) => h("li", {}, h("span", { class: `key ${className}` }), text)))
        : null,
    );
  }

  point(event) {
    const box = this.picture.getBoundingClientRect();
    const share = ((event.clientX - box.left) / box.width) * W;
    const [first, last] = this.span;
    const t = first + ((share - LEFT) / (W - LEFT - RIGHT)) * (last - first);
    this.seek(Math.min(Math.max(t, first), last));
  }

  show(t) {
    const x = this.x(Math.min(Math.max(t, this.span[0]), this.span[1]));
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
  }

  highlight(number) {
    this.paths.forEach((path, i) => path.classList.toggle("touched", i === number));
    if (this.paths[number]) this.paths[number].parentNode.insertBefore(this.paths[number], this.cursor);
  }
}

// Segments of the left ventricle as rings: base outside, apex in the middle (Cerqueira 2002).
export class BullsEye {
  constructor(header, values) {
    const { names, unit, quantity, reason } = header.segments;
    this.n = names.length;
    this.values = values;
    const real = Array.from(values).filter((v) => v > -1e8);
    this.low = Math.floor(Math.min(0, ...real) + 0.5);
    this.high = Math.max(...real, this.low + 1e-9);
    this.unit = unit;
    this.parts = names.map((name, i) => {
      const path = svg("path", { class: "segment", d: this.shape(i) });
      path.append((path.title = svg("title", {})));
      path.name = name;
      return path;
    });
    this.texts = names.map((_, i) => {
      const [x, y] = this.middle(i);
      return svg("text", { x, y: y + 4, "text-anchor": "middle", class: "segment-text" });
    });
    const walls = this.n === 17
      ? [["anterior", 110, 6], ["septal", 4, 112], ["inferior", 110, 229], ["lateral", 216, 112]]
      : [];
    this.picture = svg(
      "svg",
      { viewBox: "-28 -4 276 240", role: "img", "aria-label": `Bull's-eye: ${quantity}` },
      this.parts,
      this.texts,
      walls.map(([text, x, y]) =>
        svg("text", { class: "tick", x, y, "text-anchor": text === "septal" ? "end" : text === "lateral" ? "start" : "middle" }, text),
      ),
    );
    this.bar = bar(`${this.low.toFixed(0)} ${unit}`, `${this.high.toFixed(0)} ${unit}`);
    this.element = h(
      "figure",
      { class: "chart" },
      h("figcaption", {}, h("h3", {}, "Bull’s-eye"), h("p", { class: "note" }, `${quantity[0].toUpperCase()}${quantity.slice(1)}, ${unit}.`)),
      this.picture,
      this.bar,
      reason ? h("p", { class: "note" }, reason) : null,
    );
  }

  // Ring and sector of a segment: [inner radius, outer radius, middle in degrees, width].
  place(i) {
    if (this.n !== 17) return [[76, 50, 24, 0][i], [102, 76, 50, 24][i], 0, 360];
    if (i === 16) return [0, 24, 0, 360];
    if (i >= 12) return [24, 50, 90 + 90 * (i - 12), 90];
    return [i < 6 ? 76 : 50, i < 6 ? 102 : 76, 90 + 60 * (i % 6), 60];
  }

  shape(i) {
    const [inner, outer, middle, width] = this.place(i);
    const at = (r, degrees) => {
      const a = (degrees * Math.PI) / 180;
      return `${(110 + r * Math.cos(a)).toFixed(2)} ${(113 - r * Math.sin(a)).toFixed(2)}`;
    };
    const ring = (r, turn) => `M${at(r, 0)}A${r} ${r} 0 1 ${turn} ${at(r, 180)}A${r} ${r} 0 1 ${turn} ${at(r, 360)}Z`;
    if (width === 360) return inner ? ring(outer, 0) + ring(inner, 1) : ring(outer, 0);
    const [a, b] = [middle - width / 2, middle + width / 2];
    return `M${at(inner, a)}L${at(outer, a)}A${outer} ${outer} 0 0 0 ${at(outer, b)}L${at(inner, b)}A${inner} ${inner} 0 0 1 ${at(inner, a)}Z`;
  }

  middle(i) {
    const [inner, outer, degrees, width] = this.place(i);
    if (inner === 0) return [110, 113];
    const r = (inner + outer) / 2;
    const a = ((width === 360 ? 90 : degrees) * Math.PI) / 180;
    return [110 + r * Math.cos(a), 113 - r * Math.sin(a)];
  }

  show([first, second, share]) {
    for (let i = 0; i < this.n; i++) {
      const [a, b] = [this.values[first * this.n + i], this.values[second * this.n + i]];
      const isKnown = a > -1e8 && b > -1e8;
      const value = a + share * (b - a);
      const part = (value - this.low) / (this.high - this.low);
      this.parts[i].style.fill = isKnown ? css(part) : "transparent";
      this.texts[i].style.fill = part > 0.55 ? "#10151c" : "#ffffff";
      this.texts[i].textContent = isKnown ? value.toFixed(0) : "–";
      this.parts[i].title.textContent = isKnown
        ? `${this.parts[i].name}: ${value.toFixed(1)} ${this.unit}`
        : `${this.parts[i].name}: no vertex lies here`;
    }
  }
}

export function bar(low, high, title) {
  const strip = h("div", { class: "strip", "aria-hidden": "true", style: { background: GRADIENT } });
  const texts = [h("span", {}, low), h("span", { class: "of" }, title || ""), h("span", {}, high)];
  const element = h("div", { class: "bar" }, strip, h("div", { class: "ends" }, texts));
  element.texts = texts;
  return element;
}
