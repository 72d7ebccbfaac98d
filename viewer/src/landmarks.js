// The page at /images/{id}: landmarks are placed on slices by clicking, saved, and tracked from. With
// a track in the address it shows where its surface crosses the slices.

import { BASE, save } from "./api.js";
import { h, refill, svg } from "./dom.js";
import { plain } from "./notes.js";
import { directionOf, Frame, sidesOf } from "./slices.js";

const NAMES = [
  ["apex", "Apex", "the tip of the cavity"],
  ["base", "Base", "the middle of its opening, such as the mitral valve"],
];
// Frames that are kept: those looked at last.
const MOST_FRAMES = 12;

export class Landmarks {
  constructor(root, calls, id, open, track) {
    Object.assign(this, { root, calls, id, open, madeTrack: track });
    this.frames = new Map();
    this.frame = 0;
    this.current = "apex";
    // By name: by frame a place, mm.
    this.places = { apex: new Map(), base: new Map() };
    this.status = h("p", { class: "status", role: "status" });
    this.build();
  }

  static async at(root, calls, id, open, track) {
    const page = new Landmarks(root, calls, id, open, track);
    page.about = await calls.images(id);
    // The first frame with an image.
    while (page.about.missing.includes(page.frame)) page.frame += 1;
    await page.show(page.frame);
    page.lead();
    return page;
  }

  build() {
    this.panes = h("div", { class: "panes" });
    this.list = h("div", { class: "landmarks" });
    this.time = h("input", { type: "range", class: "time", min: 0, value: 0, step: 1, id: "frame", oninput: () => this.show(Number(this.time.value)) });
    this.moment = h("output", { for: "frame", class: "moment" });
    this.seconds = h("input", { type: "number", id: "seconds", min: 0, step: "any" });
    this.cavity = h("input", { type: "text", id: "cavity-label", maxlength: 60, autocomplete: "off", placeholder: "automatic", oninput: () => this.tell() });
    this.segmentation = h("section", { class: "card", hidden: true }, h("h2", {}, "It is a segmentation"),
      h("p", { class: "note" }, "Apex and base are proposed from it; what you place goes before. Labels are numbers, such as 3 or 1, 3."),
      h("div", { class: "seconds" }, h("label", { for: "cavity-label" }, "Label of the cavity"), this.cavity));
    this.doubt = h("p", { class: "doubt", role: "status", hidden: true });
    this.keep = h("input", { type: "checkbox", id: "keep" });
    this.start = h("button", { class: "main", disabled: true, onclick: () => this.track() }, "Track the surface");
    this.saveButton = h("button", { onclick: () => this.save() }, "Save landmarks");
    this.file = h("input", { type: "file", id: "landmark-file", accept: ".json", "aria-label": "Open a file of landmarks", onchange: () => this.load(this.file.files[0]) });
    this.progress = h("progress", { max: 1, hidden: true, "aria-label": "Tracking" });
    this.facts = h("p", { class: "facts" });
    refill(
      this.root,
      h("div", { class: "placing" },
        h("header", { class: "head" },
          h("div", {}, h("a", { class: "brand", href: `${BASE}/` }, "modalmotion"), h("h1", {}, this.madeTrack ? "The surface in the slices" : "Place apex and base"), this.facts),
          h("div", { class: "actions" }, this.saveButton, h("label", { class: "button", for: "landmark-file" }, "Open landmarks"), this.file)),
        h("div", { class: "work" },
          h("div", { class: "left" }, this.panes,
            h("div", { class: "clock" }, h("label", { for: "frame" }, "Frame"), this.time, this.moment)),
          h("aside", { class: "right" }, this.madeTrack && h("section", { class: "card" }, h("h2", {}, "Surface"),
            h("p", { class: "note" }, "The line is where the surface that was tracked crosses the slice, moved by what the slice shows everything aside."),
            h("button", { onclick: () => this.open(this.madeTrack) }, "Back to the moving surface")),
            this.segmentation,
            h("section", { class: "card" }, h("h2", {}, "Landmarks"), this.list, this.doubt,
              h("p", { class: "note" }, "Choose one, then click where it is. It shows in every view that passes by. The base may be placed in other frames too: what lies between is on a path.")),
            h("section", { class: "card" }, h("h2", {}, "Track"),
              h("p", { class: "note" }, "A surface starts between the landmarks and follows the edges of the images through all frames."),
              h("div", { class: "seconds" }, h("label", { for: "seconds" }, "Seconds per frame"), this.seconds),
              h("label", { class: "sent", for: "keep" }, this.keep, "Keep the images afterwards"),
              h("p", { class: "note" }, "Otherwise they are deleted once the surface is found."),
              this.start, this.progress, this.status)))),
    );
    this.tell();
  }

  lead() {
    const { about } = this;
    const n = about.kind === "planes" ? `${about.shapes.length} slices` : `volumes of ${about.shapes[0].join(" × ")}`;
    this.facts.textContent = `${about.n_frames} ${about.n_frames === 1 ? "frame" : "frames"}, ${n}`;
    if (about.notes.length) this.facts.append(h("span", { class: "note" }, ` ${about.notes.map((note) => plain(note.text)).join(" ")}`));
    this.time.max = about.n_frames - 1;
    this.time.disabled = about.n_frames === 1;
    const step = this.stepOf();
    this.seconds.value = step === null ? "" : String(+step.toPrecision(6));
    this.segmentation.hidden = !about.is_label_map;
    this.landmarksOfLabels();
    this.tell();
  }

  // Seconds between frames; null where the files do not say.
  stepOf() {
    const { times, n_frames: n } = this.about;
    return times && n > 1 ? (times[n - 1] - times[0]) / (n - 1) : null;
  }

  // What the labels propose, until somebody places them otherwise.
  landmarksOfLabels() {
    for (const [name] of NAMES) this.places[name] = new Map(this.about[name].flatMap((point, k) => (point ? [[k, point]] : [])));
    const first = this.placeOf("apex");
    if (first) for (const view of this.views) view.goTo(first.point);
  }

  // Landmarks of this frame that lie further than 2 mm outside what is labelled.
  doubts() {
    if (!this.about || !this.about.is_label_map || !this.views) return [];
    return NAMES.filter(([name]) => {
      const here = this.places[name].get(this.frame);
      return here && !this.views.some((view) => view.holds(here, 2));
    }).map(([name]) => name);
  }

  async show(number) {
    this.frame = number;
    this.time.value = number;
    const seconds = this.about.times && this.about.times[number];
    this.moment.textContent = `${number}${seconds == null ? "" : `, ${seconds.toFixed(3)} s`}`;
    if (this.about.missing.includes(number)) {
      this.status.textContent = `There is no image of frame ${number}.`;
      return;
    }
    let wanted = this.frames.get(number);
    if (!wanted) {
      wanted = this.calls.slices(this.id, number, this.madeTrack).then((buffer) => new Frame(buffer));
      this.frames.set(number, wanted);
      if (this.frames.size > MOST_FRAMES) this.frames.delete(this.frames.keys().next().value);
    }
    let shown;
    try {
      shown = await wanted;
    } catch (error) {
      this.frames.delete(number);
      this.status.textContent = error.message;
      return;
    }
    // Another frame may have been asked for meanwhile.
    if (number !== this.frame) return;
    if (!this.views) {
      this.views = shown.stacks.map((stack, k) => new Pane(this, stack, k));
      refill(this.panes, this.views.map((view) => view.element));
    }
    this.views.forEach((view, k) => view.use(shown.stacks[k], shown.surface));
    this.tell();
  }

  place(point) {
    this.isPlaced = true;
    this.places[this.current].set(this.frame, point);
    // Every view turns to the slice that the place is in.
    for (const view of this.views) view.goTo(point);
    const next = NAMES.find(([name]) => !this.places[name].size);
    if (next) this.current = next[0];
    this.tell();
  }

  remove(name) {
    this.isPlaced = true;
    this.places[name].delete(this.frame);
    this.tell();
  }

  // The place in this frame, or else in the nearest frame that has one.
  placeOf(name) {
    const own = this.places[name];
    if (!own.size) return null;
    const frame = [...own.keys()].reduce((best, k) => (Math.abs(k - this.frame) < Math.abs(best - this.frame) ? k : best));
    return { point: own.get(frame), isHere: frame === this.frame };
  }

  tell() {
    const rows = NAMES.map(([name, title, text]) => {
      const own = this.places[name];
      const here = own.get(this.frame);
      const input = h("input", { type: "radio", name: "landmark", id: `landmark-${name}`, value: name, onchange: () => (this.current = name) });
      input.checked = this.current === name;
      const where = here
        ? here.map((x) => x.toFixed(1)).join(", ") + " mm"
        : own.size ? `in frame ${[...own.keys()].sort((a, b) => a - b).join(", ")}` : text;
      return h("div", { class: "landmark" }, input, h("span", { class: `mark ${name}` }), h("label", { for: input.id }, title, h("span", {}, where)),
        here && h("button", { onclick: () => this.remove(name), "aria-label": `Take the ${name} away from this frame` }, "×"));
    });
    refill(this.list, rows);
    const doubts = this.doubts();
    this.doubt.hidden = !doubts.length;
    this.doubt.textContent = doubts.length ? `The ${doubts.join(" and the ")} ${doubts.length === 1 ? "lies" : "lie"} more than 2 mm outside what is labelled.` : "";
    const isReady = Boolean(this.about && this.about.is_label_map && this.cavity.value.trim()) || NAMES.every(([name]) => this.places[name].size);
    this.start.disabled = !isReady || this.isTracking;
    this.saveButton.disabled = !NAMES.some(([name]) => this.places[name].size);
    for (const view of this.views || []) view.mark();
  }

  // A place of the first frame, or one for each frame and null where it is unknown.
  asJson() {
    const written = {};
    for (const [name] of NAMES) {
      const own = this.places[name];
      if (!own.size) continue;
      const round = (point) => point.map((x) => Math.round(x * 1000) / 1000);
      if (own.size === 1 && own.has(0)) written[name] = round(own.get(0));
      else written[name] = Array.from({ length: this.about.n_frames }, (_, k) => (own.has(k) ? round(own.get(k)) : null));
    }
    return written;
  }

  save() {
    const text = JSON.stringify({ coordinates: "LPS", unit: "mm", landmarks: this.asJson() }, null, 1);
    save(new Blob([text], { type: "application/json" }), `${this.id.slice(0, 12)}.landmarks.json`);
  }

  async load(file) {
    this.isPlaced = true;
    try {
      const { landmarks, coordinates = "LPS", unit = "mm" } = JSON.parse(await file.text());
      if (!landmarks || coordinates !== "LPS" || unit !== "mm") throw new Error("not ours");
      for (const [name] of NAMES) {
        const value = landmarks[name];
        if (!value) continue;
        const frames = typeof value[0] === "number" ? [value] : value;
        this.places[name] = new Map(frames.flatMap((point, k) => (point ? [[k, point.map(Number)]] : [])));
      }
      this.status.textContent = "";
    } catch {
      this.status.textContent = "This file holds no landmarks in LPS mm, as this page saves them.";
    }
    this.file.value = "";
    const first = this.placeOf("apex") || this.placeOf("base");
    if (first) for (const view of this.views) view.goTo(first.point);
    this.tell();
  }

  async track() {
    this.isTracking = true;
    this.start.disabled = true;
    this.progress.hidden = false;
    this.progress.removeAttribute("value");
    this.status.textContent = "Looking for the surface";
    this.calls.onJob = (job) => {
      if (job.progress > 0) this.progress.value = job.progress;
      this.status.textContent = job.text || "Following the surface";
    };
    const query = { images: this.id };
    // What the labels propose is proposed again, with its own error.
    if (this.isPlaced || !this.about.is_label_map) query.landmarks = JSON.stringify(this.asJson());
    if (this.cavity.value.trim()) query.labels = this.cavity.value.replaceAll(" ", "");
    if (this.keep.checked) query.keep = "true";
    const seconds = Number(this.seconds.value);
    if (seconds > 0 && seconds !== this.stepOf()) query.frame_interval = seconds;
    try {
      const { id } = await this.calls.follow(query);
      const name = history.state && history.state.name;
      if (name) await this.calls.change(id, { name });
      await this.open(id);
    } catch (error) {
      this.status.textContent = error.message;
    } finally {
      this.isTracking = false;
      this.progress.hidden = true;
      this.calls.onJob = null;
      this.tell();
    }
  }

  dispose() {}
}

// One stack of slices, of which one is seen.
class Pane {
  constructor(page, stack, number) {
    this.page = page;
    this.number = Math.floor(stack.length / 2);
    this.cursor = null;
    this.title = directionOf(stack[0], number);
    this.canvas = h("canvas", {
      tabindex: 0, role: "img",
      onclick: (event) => this.click(event),
      onkeydown: (event) => this.key(event),
      onwheel: (event) => {
        event.preventDefault();
        this.turn(Math.sign(event.deltaY));
      },
    });
    this.marks = h("div", { class: "marks" });
    this.line = svg("path", {});
    this.contours = svg("svg", { class: "contours", preserveAspectRatio: "none", "aria-hidden": "true" }, this.line);
    this.slider = h("input", { type: "range", min: 0, max: stack.length - 1, step: 1, "aria-label": `${this.title}, slice`, oninput: () => this.goToNumber(Number(this.slider.value)) });
    this.slider.hidden = stack.length === 1;
    this.caption = h("span", {});
    this.letters = ["left", "right", "top", "bottom"].map((side) => h("span", { class: `side ${side}`, "aria-hidden": "true" }));
    this.picture = h("div", { class: "slice" }, this.canvas, this.contours, this.marks, this.letters);
    this.element = h("figure", { class: "pane" }, this.picture, h("figcaption", {}, h("strong", {}, this.title), this.caption, this.slider));
  }

  get slice() {
    return this.stack[this.number];
  }

  use(stack, surface) {
    this.stack = stack;
    this.surface = surface;
    this.goToNumber(Math.min(this.number, stack.length - 1));
  }

  turn(step) {
    this.goToNumber(Math.min(Math.max(this.number + step, 0), this.stack.length - 1));
  }

  goToNumber(number) {
    this.number = number;
    this.slider.value = number;
    const { slice } = this;
    slice.paint(this.canvas);
    const segments = this.surface ? slice.contours(this.surface) : [];
    this.contours.setAttribute("viewBox", `-0.5 -0.5 ${slice.counts[0]} ${slice.counts[1]}`);
    this.line.setAttribute("d", segments.map(([i, j, k, l]) => `M${i.toFixed(2)} ${j.toFixed(2)}L${k.toFixed(2)} ${l.toFixed(2)}`).join(""));
    const [width, height] = [slice.counts[0] * slice.spacing[0], slice.counts[1] * slice.spacing[1]];
    // Pixels need not be square.
    this.picture.style.aspectRatio = `${width} / ${height}`;
    this.caption.textContent = ` ${number + 1} of ${this.stack.length}`;
    this.canvas.setAttribute("aria-label", `${this.title}, slice ${number + 1} of ${this.stack.length}. Arrows move a cross, Enter places the landmark, Page Up and Down change the slice.`);
    const sides = sidesOf(slice);
    for (const letter of this.letters) letter.textContent = sides[letter.classList[1]];
    this.mark();
  }

  // The slice nearest to a place.
  goTo(point) {
    const off = this.stack.map((slice) => Math.abs(slice.under(point).off));
    this.goToNumber(off.indexOf(Math.min(...off)));
  }

  // Whether anything but background lies within some mm of a place.
  holds(point, reach) {
    return this.stack.some((slice) => {
      const { i, j, off } = slice.under(point);
      const rest = reach + slice.thickness / 2 - Math.abs(off);
      return rest >= 0 && slice.isInk(i, j, Math.max(reach, 0.5));
    });
  }

  mark() {
    if (!this.stack) return;
    const { slice } = this;
    const [width, height] = slice.counts;
    const marks = [];
    for (const [name, title] of NAMES) {
      const own = this.page.placeOf(name);
      if (!own) continue;
      const { i, j, off } = slice.under(own.point);
      const isNear = Math.abs(off) <= slice.thickness / 2 + 1;
      if (Math.abs(off) > 2 * slice.thickness + 2 || i < -0.5 || j < -0.5 || i > width - 0.5 || j > height - 0.5) continue;
      const dot = h("span", { class: `mark ${name}${isNear ? "" : " off"}${own.isHere ? "" : " elsewhere"}`, title });
      dot.style.left = `${(100 * (i + 0.5)) / width}%`;
      dot.style.top = `${(100 * (j + 0.5)) / height}%`;
      marks.push(dot);
    }
    if (this.cursor) {
      const cross = h("span", { class: "mark cursor" });
      cross.style.left = `${(100 * (this.cursor[0] + 0.5)) / width}%`;
      cross.style.top = `${(100 * (this.cursor[1] + 0.5)) / height}%`;
      marks.push(cross);
    }
    refill(this.marks, marks);
  }

  click(event) {
    const box = this.canvas.getBoundingClientRect();
    const [width, height] = this.slice.counts;
    const i = ((event.clientX - box.left) / box.width) * width - 0.5;
    const j = ((event.clientY - box.top) / box.height) * height - 0.5;
    this.cursor = null;
    this.page.place(this.slice.at(i, j));
  }

  key(event) {
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const [width, height] = this.slice.counts;
    if (ways[event.key]) {
      const step = event.shiftKey ? 10 : 1;
      const [i, j] = this.cursor || [Math.floor(width / 2), Math.floor(height / 2)];
      const [di, dj] = ways[event.key];
      this.cursor = [Math.min(Math.max(i + di * step, 0), width - 1), Math.min(Math.max(j + dj * step, 0), height - 1)];
      this.mark();
    } else if (event.key === "PageUp" || event.key === "PageDown") this.turn(event.key === "PageUp" ? -1 : 1);
    else if (event.key === "Enter" && this.cursor) this.page.place(this.slice.at(...this.cursor));
    else return;
    event.preventDefault();
  }
}
