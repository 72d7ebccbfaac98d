// Curves over time, and the bull's-eye.

import { h, numeral, svg } from "./dom.js";
import { css, GRADIENT } from "./viridis.js";

const [W, H] = [420, 236];
const [LEFT, TOP, BOTTOM] = [46, 22, 34];

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

// A chart of curves, each { points, className, tone, dash, area, reach, end }, over `at`; `reach` is
// half of each interval, `end` a word at its end. A click moves the time there.
export class CurveChart {
  constructor({ title, note, at, xLabel, yLabel, curves, marks = [], legend = [], below, fromZero, seek }) {
    this.at = at;
    this.seek = seek;
    this.right = curves.some((c) => c.end) ? 58 : 14;
    const all = curves.flatMap((c) => (c.reach ? c.points.flatMap((v, i) => [v - c.reach[i], v + c.reach[i]]) : c.points)).filter(Number.isFinite);
    let [low, high] = [Math.min(...all), Math.max(...all)];
    if (fromZero) low = Math.min(low, 0);
    if (!(high > low)) [low, high] = [low - 1, high + 1];
    const pad = (marks.some((m) => m.text) ? 0.14 : 0.06) * (high - low);
    [low, high] = [fromZero && low === 0 ? 0 : low - pad, high + pad];
    const [first, last] = [at[0], at[at.length - 1] > at[0] ? at[at.length - 1] : at[0] + 1];
    this.x = (t) => LEFT + ((t - first) / (last - first)) * (W - LEFT - this.right);
    this.y = (v) => H - BOTTOM - ((v - low) / (high - low)) * (H - TOP - BOTTOM);
    const across = ticks(first, last, 5);
    const up = ticks(low, high, 4);
    const path = (points) =>
      points.map((v, i) => `${i ? "L" : "M"}${this.x(at[i]).toFixed(1)} ${this.y(v).toFixed(1)}`).join("");
    const back = (points) =>
      points.map((v, i) => `L${this.x(at[i]).toFixed(1)} ${this.y(v).toFixed(1)}`).reverse().join("");
    this.paths = curves.map((c) =>
      c.area
        ? svg("path", { class: c.className, d: `${path(c.points)}L${this.x(at[at.length - 1])} ${this.y(low)}L${this.x(at[0])} ${this.y(low)}Z` })
        : svg("path", { class: `curve ${classOf(c)}`, "stroke-dasharray": c.dash && c.dash.length ? c.dash.join(" ") : null, d: path(c.points) }),
    );
    const bands = curves.filter((c) => c.reach).map((c) =>
      svg("path", { class: `band ${classOf(c)}`, d: `${path(c.points.map((v, i) => v + c.reach[i]))}${back(c.points.map((v, i) => v - c.reach[i]))}Z` }));
    this.cursor = svg("line", { class: "cursor", y1: TOP, y2: H - BOTTOM });
    this.picture = svg(
      "svg",
      { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": `${title}. ${note || ""}` },
      up.map((v) => svg("line", { class: "grid", x1: LEFT, x2: W - this.right, y1: this.y(v), y2: this.y(v) })),
      up.map((v) => svg("text", { class: "tick", x: LEFT - 6, y: this.y(v) + 4, "text-anchor": "end" }, tickText(v, up))),
      across.map((t) => svg("text", { class: "tick", x: this.x(t), y: H - BOTTOM + 15, "text-anchor": "middle" }, tickText(t, across))),
      svg("text", { class: "axis", x: (LEFT + W - this.right) / 2, y: H - 3, "text-anchor": "middle" }, xLabel),
      svg("text", { class: "axis", x: -(H - BOTTOM + TOP) / 2, y: 11, "text-anchor": "middle", transform: "rotate(-90)" }, yLabel),
      marks.filter((m) => m.name).map(({ at: t, name }) => [
        svg("line", { class: "moment-line", x1: this.x(t), x2: this.x(t), y1: TOP, y2: H - BOTTOM }),
        svg("text", { class: "tick strong", x: this.x(t), y: TOP - 7, "text-anchor": name.length > 4 && t === first ? "start" : "middle" }, name),
      ]),
      bands,
      this.paths,
      marks.filter((m) => m.text).map(({ at: t, value, text, above }) => [
        svg("circle", { class: "mark", cx: this.x(t), cy: this.y(value), r: 3.5 }),
        svg("text", {
          class: "tick strong",
          x: Math.min(Math.max(this.x(t), LEFT + 26), W - this.right - 24),
          y: this.y(value) + (above ? -7 : 15),
          "text-anchor": "middle",
        }, text),
      ]),
      this.ends(curves),
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
      legend.length ? h("ul", { class: "legend" }, legend.map(([className, text]) => h("li", {}, keyOf(className), text))) : null,
      below || null,
    );
  }

  // Words at the ends of curves, pushed apart where they would lie on one another.
  ends(curves) {
    const named = curves.filter((c) => c.end).map((c) => ({ ...c, y: this.y(c.points[c.points.length - 1]) }));
    named.sort((a, b) => a.y - b.y);
    const least = 12;
    named.forEach((c, i) => i && (c.y = Math.max(c.y, named[i - 1].y + least)));
    const over = named.length ? named[named.length - 1].y - (H - BOTTOM) : 0;
    if (over > 0) named.reverse().forEach((c, i) => (c.y = Math.min(c.y, i ? named[i - 1].y - least : H - BOTTOM)));
    return named.map((c) => svg("text", { class: `end ${classOf(c)}`, x: W - this.right + 5, y: c.y + 4 }, c.end));
  }

  point(event) {
    const box = this.picture.getBoundingClientRect();
    const share = ((event.clientX - box.left) / box.width) * W;
    const [first, last] = this.span;
    const t = first + ((share - LEFT) / (W - LEFT - this.right)) * (last - first);
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

const classOf = ({ tone, className }) => (tone === undefined ? className || "" : `tone tone${tone}`);

// A short piece of a curve, as it is drawn: { tone, dash } of a mode, or a class.
export function keyOf(kind) {
  const own = typeof kind === "string" ? { className: kind } : kind;
  return svg("svg", { class: "key", viewBox: "0 0 26 8", "aria-hidden": "true" },
    own.className === "area"
      ? svg("rect", { class: "area", x: 1, y: 0, width: 24, height: 8 })
      : svg("path", { class: `curve ${classOf(own)}`, "stroke-dasharray": own.dash && own.dash.length ? own.dash.join(" ") : null, d: "M0 4H26" }));
}

// Segments of the left ventricle as rings: base outside, apex in the middle (Cerqueira 2002), at end
// systole. `place`, where it is there, leads to where the anterior wall is stated.
export class BullsEye {
  constructor({ names, unit, quantities, end_systole: frame, reason }, moment, place) {
    this.n = names.length;
    this.names = names;
    this.unit = unit;
    this.parts = names.map((_, i) => {
      const path = svg("path", { class: "segment", d: this.shape(i) });
      path.append((path.title = svg("title", {})));
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
      { viewBox: "-28 -4 276 240", role: "img" },
      this.parts,
      this.texts,
      walls.map(([text, x, y]) =>
        svg("text", { class: "tick", x, y, "text-anchor": text === "septal" ? "end" : text === "lateral" ? "start" : "middle" }, text),
      ),
    );
    this.bar = bar("", "");
    this.note = h("p", { class: "note" });
    const choice = h("select", { "aria-label": "What the segments show", onchange: () => this.use(quantities[choice.selectedIndex]) },
      quantities.map(({ name }) => h("option", {}, name)));
    this.moment = `at end systole (frame ${frame}${moment})`;
    const rows = names.map((name, i) =>
      h("tr", {}, h("th", { scope: "row" }, name), quantities.map(({ values, reach }) =>
        h("td", {}, values[i] === null ? "–" : `${values[i].toFixed(1)}${reach ? ` ± ${reach[i].toFixed(1)}` : ""}`))));
    this.element = h(
      "figure",
      { class: "chart" },
      h("figcaption", {}, h("div", { class: "chart-head" }, h("h3", {}, this.n === 17 ? "Segments" : "Rings"), quantities.length > 1 ? choice : null), this.note),
      this.picture,
      this.bar,
      reason && !place ? h("p", { class: "note" }, reason) : null,
      reason && place ? h("p", { class: "note" }, "Segments need to know where the anterior wall is. ", h("button", { type: "button", onclick: place }, "Place the anterior wall")) : null,
      h("details", {}, h("summary", {}, "All values, %"),
        h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Values of the segments" },
          h("table", { class: "figures" }, h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "Segment"), quantities.map(({ name }) => h("th", { scope: "col" }, name)))), h("tbody", {}, rows)))),
    );
    this.use(quantities[0]);
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

  use({ definition, values }) {
    const known = values.filter((v) => v !== null);
    // Shortening is negative: the strongest is at the bright end in either sense.
    const sense = known.reduce((sum, v) => sum + v, 0) < 0 ? -1 : 1;
    const scaled = known.map((v) => sense * v);
    const [low, high] = [Math.min(0, ...scaled), Math.max(...scaled, 1e-9)];
    this.note.textContent = `${definition[0].toUpperCase()}${definition.slice(1)}, ${this.moment}.`;
    this.picture.setAttribute("aria-label", `Bull’s-eye: ${definition}, ${this.moment}`);
    this.bar.texts[0].textContent = `${(sense * low).toFixed(0)} ${this.unit}`;
    this.bar.texts[2].textContent = `${(sense * high).toFixed(0)} ${this.unit}`;
    values.forEach((value, i) => {
      const part = value === null ? 0 : (sense * value - low) / (high - low || 1);
      this.parts[i].style.fill = value === null ? "transparent" : css(part);
      this.texts[i].style.fill = value === null ? "" : part > 0.55 ? "#10151c" : "#ffffff";
      this.texts[i].textContent = value === null ? "–" : value.toFixed(0).replace("-", "−");
      this.parts[i].title.textContent = value === null ? `${this.names[i]}: no vertex lies here` : `${this.names[i]}: ${value.toFixed(1)} ${this.unit}`;
    });
  }
}

export function bar(low, high, title) {
  const strip = h("div", { class: "strip", "aria-hidden": "true", style: { background: GRADIENT } });
  const texts = [h("span", {}, low), h("span", { class: "of" }, title || ""), h("span", {}, high)];
  const element = h("div", { class: "bar" }, strip, h("div", { class: "ends" }, texts));
  element.texts = texts;
  return element;
}
