// The view of one sequence, or of two side by side: stage, clock, modes, charts.

import { About } from "./about.js";
import { readAddress, writeAddress } from "./address.js";
import { BASE, save } from "./api.js";
import { chartsOf } from "./chart_rows.js";
import { classCard } from "./class_card.js";
import { ClockRow } from "./clock_row.js";
import { Cloud } from "./cloud.js";
import { COLOURS, ColourRow } from "./colour_row.js";
import { differenceCharts } from "./compare.js";
import { readContainer } from "./container.js";
import { h } from "./dom.js";
import { saveTable } from "./frame_table.js";
import { headOf } from "./head.js";
import { modeCard } from "./mode_card.js";
import { ModePictures } from "./mode_pictures.js";
import { Motion } from "./motion.js";
import { notesOf } from "./notes.js";
import { Places } from "./places.js";
import { readoutCard } from "./readouts.js";
import { Stage } from "./stage.js";
import { trackCard } from "./tracking.js";
import { crossOfAxes, turnCross, windowsOf } from "./windows.js";

export const nameOf = ({ title, sequence_id: id }) => title || id.slice(0, 8);

export class Viewer {
  // `payloads`: one or two ArrayBuffers; `actions`: { frames(motion), data(motion), page, classify ... },
  // with `record` and `change(stated)` where what is known of it can be stated, and `compare`, the
  // picker of what is shown beside it.
  constructor(root, payloads, actions = {}, isEmbedded = false) {
    this.motions = payloads.map((payload) => new Motion(readContainer(payload)));
    this.actions = actions;
    this.isEmbedded = isEmbedded;
    (actions.titles || []).forEach((title, number) => title && (this.motions[number].header.title = title));
    this.header = this.motions[0].header;
    this.state = isEmbedded ? {} : readAddress();
    this.gains = this.motions.map((motion) => new Float32Array(motion.header.waves.length).fill(1));
    this.time = 0;
    this.isPlaying = false;
    this.clouds = this.motions.map(() => null);
    this.root = root;
    // A single file has its first view in its text.
    if (!root.querySelector(":scope > .first")) root.replaceChildren(this.sketch());
    // What is read stands before anything is drawn, which takes longer.
    requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(() => this.start())));
  }

  // Head and read-outs, as `build` has them.
  sketch() {
    const titles = this.motions.map(({ header }) => (this.motions.length > 1 ? nameOf(header) : ""));
    return h("div", { class: "viewer" },
      headOf(this.motions[0], { isServed: this.actions.isServed }, this.isEmbedded),
      h("div", { class: "work" },
        h("section", { class: "left" }, h("div", { class: "stage" })),
        h("aside", { class: "right" }, this.motions.map(({ header }, number) => readoutCard(header, titles[number])), classCard(this.header))),
      notesOf(this.header));
  }

  start() {
    if (this.isDisposed) return;
    this.root.replaceChildren(this.build());
    // A cell of a notebook keeps its height until then: what is below would move, and it out of sight.
    this.root.style.minHeight = "";
    this.isBuilt = true;
    this.applyAddress();
    this.loadFrames();
    this.loadData();
    this.onKey = (event) => this.key(event);
    document.addEventListener("keydown", this.onKey);
    this.onResize = () => this.wish();
    addEventListener("resize", this.onResize);
    this.observer = new ResizeObserver(this.onResize);
    this.observer.observe(this.canvas);
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (!still && this.nFrames > 1 && !this.state.frame && this.state.play !== "0") this.play(true);
    // A still picture is most telling at end systole.
    else if (!this.state.frame && this.motions[0].moments) this.seek(this.motions[0].timeAt(this.motions[0].moments[1]));
    this.wish();
  }

  get nFrames() {
    return this.motions[0].nFrames;
  }

  get span() {
    return this.motions[0].span;
  }

  get hasCavity() {
    return this.motions.every(({ moments, faces }) => moments && faces.length);
  }

  get usualColour() {
    return this.hasCavity ? "inward" : this.motions[0].faces.length ? "motion" : "plain";
  }

  // Place in each motion: two sequences run through their own span together.
  place(number) {
    const motion = this.motions[number];
    if (number === 0) return motion.placeAt(this.time);
    return motion.placeAt((this.time / (this.span || 1)) * motion.span);
  }

  applyAddress() {
    const { frame, colour, gains, sent, data } = this.state;
    if (frame) this.seek(this.motions[0].timeAt(Math.min(Math.max(+frame || 0, 0), this.nFrames - 1)));
    this.setColour(COLOURS.some(([name]) => name === colour && (this.hasCavity || name !== "inward")) ? colour : this.usualColour);
    if (sent === "0") this.showSent(false);
    if (data === "0") this.showData(false);
    if (gains)
      gains.split(",").forEach((gain, w) => {
        if (w < this.gains[0].length && Number.isFinite(+gain)) this.setGain(w, +gain);
      });
    if (this.state.speed) this.clock.setSpeed(+this.state.speed || 1);
    this.isReady = true;
  }

  writeAddress() {
    if (this.isEmbedded || !this.isReady || !location.pathname.startsWith(`${BASE}/view/`)) return;
    clearTimeout(this.writing);
    this.writing = setTimeout(() => {
      const { colour, usualColour, gains, isSentShown, areDataShown } = this;
      const frame = this.isPlaying ? "" : String(Math.round(this.place(0)));
      writeAddress({ frame, colour, usualColour, gains: gains[0], isSentShown, areDataShown });
    }, 300);
  }

  build() {
    const { header, actions } = this;
    const [motion] = this.motions;
    this.clock = new ClockRow(motion, () => this.play(!this.isPlaying), (frame) => {
      this.play(false);
      this.seek(motion.timeAt(frame));
    });
    const showOnly = (waves) => this.showOnly(waves);
    this.modes = modeCard(header, { setGain: (w, gain) => this.setGain(w, gain), showOnly, highlight: (w) => this.highlight(w) });
    const say = (text) => this.say(text);
    const headActions = { ...actions, csv: () => saveTable(motion, `${this.fileName}-frames.csv`), picture: () => this.savePicture() };
    this.canvas = h("canvas", {
      tabindex: "0", role: "application",
      "aria-label": "The moving surface. Arrow keys turn it, plus and minus bring it nearer, Home resets the view.",
    });
    this.stage = new Stage(this.canvas, () => this.wish());
    this.surfaces = this.motions.map((each) => this.stage.surfaces(each));
    this.stage.panels = this.motions.flatMap((each, i) => windowsOf(each, i, this.surfaces[i], this.motions.length === 1));
    this.windows = h("div", { class: "windows" }, this.stage.panels.map(({ element }) => element));
    this.cross = crossOfAxes();
    this.busy = h("p", { class: "busy", role: "status" });
    this.isSentShown = true;
    this.areDataShown = true;
    this.colours = new ColourRow({
      setColour: (name) => this.setColour(name),
      showSent: (isShown) => this.showSent(isShown),
      showData: (areShown) => this.showData(areShown),
    }, this.hasCavity);
    this.places = new Places(this);
    const stageBox = h("div", { class: "stage" }, this.canvas, this.windows, this.cross, this.busy, this.places.prompt);
    const about = actions.record && new About(actions.record, motion, {
      change: actions.change,
      place: (words, done) => this.places.choose(words, done),
      marked: (landmarks) => this.places.show(landmarks),
    });
    const lead = about && ((name) => about.lead(name));
    const charts = chartsOf(this.motions, (number, t) => {
      this.play(false);
      this.seek(number ? (t / (this.motions[number].span || 1)) * this.span : t);
    }, lead && (() => lead("anterior")));
    this.charts = charts.rows;
    this.differences = this.motions.length > 1 ? differenceCharts(this.motions, this.motions.map((one) => nameOf(one.header)), (share) => {
      this.play(false);
      this.seek(share * this.span);
    }) : null;
    this.pictures = new ModePictures(this.stage, motion, this.modes.pictures);
    return h(
      "div",
      { class: "viewer" },
      headOf(motion, headActions, this.isEmbedded, say, actions.compare),
      h(
        "div",
        { class: "work" },
        h("section", { class: "left", "aria-label": "Surface" }, stageBox, this.clock.element, this.colours.element),
        h("aside", { class: "right", "aria-label": "Read-outs" },
          this.motions.map((one) => readoutCard(one.header, this.motions.length > 1 ? nameOf(one.header) : "", lead)),
          classCard(header, actions.classify, showOnly, lead),
          about && about.element,
          actions.norms || null,
          header.is_tracked && actions.track ? trackCard(actions.track, header.unit, say) : null),
      ),
      this.differences && this.differences.element,
      this.modes.element,
      charts.element,
      notesOf(header, this.stage.isSoftware, lead),
      h("p", { class: "foot" }, header.intended_use),
    );
  }

  async loadFrames() {
    for (const motion of this.motions) {
      if (!this.actions.frames) continue;
      try {
        await this.actions.frames(motion, (piece) => {
          motion.sent.add(piece instanceof ArrayBuffer ? readContainer(piece) : piece);
          this.wish();
        });
      } catch (error) {
        this.say(`The frames as sent did not come: ${error.message}`);
      }
    }
    this.wish();
  }

  // Points that the surfaces were tracked through, where somebody kept them.
  async loadData() {
    if (!this.actions.data) return;
    for (const [number, motion] of this.motions.entries()) {
      try {
        const buffer = await this.actions.data(motion);
        if (!buffer) continue;
        const cloud = new Cloud(buffer, motion);
        Object.values(this.surfaces[number]).forEach((surface) => surface.scene && cloud.join(surface));
        this.clouds[number] = cloud;
      } catch (error) {
        this.say(`The data that were tracked did not come: ${error.message}`);
      }
    }
    this.colours.offer(this.clouds.filter(Boolean));
    this.wish();
  }

  showData(areShown) {
    this.areDataShown = areShown;
    this.colours.data.checked = areShown;
    this.wish();
    this.writeAddress();
  }

  say(text) {
    this.busy.textContent = text;
  }

  setColour(name) {
    this.colour = name;
    this.colours.mark(name);
    this.wish();
    this.writeAddress();
  }

  showSent(isShown) {
    this.isSentShown = isShown;
    this.colours.sent.checked = isShown;
    for (const panel of this.stage.panels)
      if (panel.kind === "sent") {
        panel.isShown = isShown;
        panel.element.hidden = !isShown;
      }
    this.windows.classList.toggle("single", !isShown && this.motions.length === 1);
    this.wish();
    this.writeAddress();
  }

  setGain(w, gain) {
    this.gains.forEach((own, number) => {
      const label = this.header.waves[w].label;
      const there = number === 0 ? w : this.motions[number].header.waves.findIndex((wave) => wave.label === label);
      if (there >= 0) own[there] = gain;
    });
    this.modes.show(w, gain);
    this.wish();
    this.writeAddress();
  }

  showOnly(waves) {
    this.gains[0].forEach((_, w) => this.setGain(w, waves.includes(w) ? 1 : 0));
    if (waves.length) this.highlight(waves[0]);
  }

  highlight(w) {
    for (const { motion, trajectories } of this.charts) {
      const label = this.header.waves[w].label;
      trajectories.highlight(motion.header.waves.findIndex((wave) => wave.label === label));
    }
  }

  play(isPlaying) {
    if (isPlaying && this.header.cycle === "open" && this.time >= this.motions[0].timeAt(this.nFrames - 1)) this.time = 0;
    this.isPlaying = isPlaying && this.nFrames > 1;
    this.clock.showPlaying(this.isPlaying);
    this.before = null;
    if (!isPlaying && this.isReady) {
      // Still pictures are of frames that were measured.
      const frame = Math.round(this.place(0));
      this.time = this.motions[0].timeAt(Math.min(frame, this.nFrames - 1));
      this.writeAddress();
    }
    this.wish();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.span);
    this.wish();
    if (!this.isPlaying) this.writeAddress();
  }

  step(by) {
    this.play(false);
    const frame = Math.round(this.place(0)) + by;
    const n = this.nFrames;
    this.seek(this.motions[0].timeAt(this.header.cycle === "open" ? Math.min(Math.max(frame, 0), n - 1) : (frame + n) % n));
  }

  key(event) {
    const at = event.target;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (at.closest && at.closest("input, select, textarea, button, a, dialog")) return;
    if (this.isEmbedded && !this.root.contains(at)) return;
    const works = { " ": () => this.play(!this.isPlaying), ",": () => this.step(-1), ".": () => this.step(1) };
    if (!works[event.key]) return;
    event.preventDefault();
    works[event.key]();
  }

  // Ask for a picture at the next chance.
  wish() {
    if (this.wished) return;
    this.wished = requestAnimationFrame((now) => {
      this.wished = 0;
      this.frame(now);
    });
  }

  frame(now) {
    if (this.isPlaying) {
      const passed = this.before === null ? 0 : Math.min((now - this.before) / 1000, 0.25);
      this.before = now;
      this.time += passed * this.clock.pace;
      if (this.time >= this.span) {
        if (this.header.cycle === "open") {
          this.time = this.span;
          this.play(false);
        } else this.time %= this.span || 1;
      }
      this.wish();
    }
    this.show();
  }

  // Ends of the colour bar, and what it shows: of the error the stated one, unless modes are changed.
  scaleOf() {
    const isWhole = this.gains[0].every((gain) => gain === 1);
    if (this.colour === "inward") {
      const ranges = this.motions.map(({ inwardRange }) => inwardRange);
      return [[Math.min(...ranges.map(([low]) => low)), Math.max(...ranges.map(([, high]) => high))], "since end diastole"];
    }
    const moved = Math.max(...this.motions.map(({ arrays }) => 2 * Math.max(...arrays.motion_rms.values)));
    if (this.colour === "motion") return [[0, moved], "displacement"];
    if (!isWhole) return [[0, moved], "what is shown, against what was sent"];
    return [[0, Math.max(...this.motions.map(({ header }) => header.error.max))], "distance to what was sent"];
  }

  show() {
    const started = performance.now();
    const [range, title] = this.scaleOf();
    const coloured = { plain: 0, error: 1, motion: 2, inward: 3 }[this.colour];
    for (const panel of this.stage.panels) {
      if (!panel.isShown) continue;
      // Beside its reconstruction a surface as sent is plain, unless it stands for the motion.
      const own = panel.kind === "sent" ? (coloured === 1 ? 0 : coloured) : coloured;
      const isThere = panel.surface.update(this.place(panel.number), this.gains[panel.number], own, range[1], range[0]);
      panel.surface.object.visible = isThere;
      panel.element.classList.toggle("waiting", !isThere);
    }
    this.clouds.forEach((cloud, number) => cloud && cloud.show(this.place(number), this.areDataShown, this.stage.ratio));
    this.stage.render();
    this.milliseconds = performance.now() - started;
    this.colours.showScale(this.colour, range, title, this.header.unit);
    const place = this.place(0);
    const frame = Math.min(Math.round(place), this.nFrames - 1);
    this.clock.show(this.time, frame);
    this.charts.forEach(({ motion, charts }, number) => {
      const t = number ? (this.time / (this.span || 1)) * motion.span : this.time;
      charts.forEach((chart) => chart.show(t));
    });
    if (this.differences) this.differences.charts.forEach((chart) => chart.show((100 * this.time) / (this.span || 1)));
    this.pictures.show(this.time / (this.span || 1), this.isPlaying);
    this.places.move();
    turnCross(this.cross, this.stage.axes(this.header.view));
  }

  // Of files that are saved: the recording's own name, or the start of its id.
  get fileName() {
    const { title, sequence_id: id } = this.header;
    return (title || id.slice(0, 12)).replace(/\.[a-z0-9.]{2,8}$/i, "").replace(/[^\p{L}\p{N}._-]+/gu, "-").replace(/^-+|-+$/g, "").slice(0, 60) || id.slice(0, 12);
  }

  savePicture() {
    this.show();
    this.canvas.toBlob((blob) => save(blob, `${this.fileName}.png`));
  }

  // What a test reads: positions and colours as drawn, at a frame and with gains.
  read(number, kind, place, gains, coloured) {
    const surface = this.surfaces[number][kind];
    return surface.read(this.stage.renderer, place, Float32Array.from(gains), coloured, 1);
  }

  dispose() {
    this.isDisposed = true;
    if (!this.isBuilt) return;
    cancelAnimationFrame(this.wished);
    document.removeEventListener("keydown", this.onKey);
    removeEventListener("resize", this.onResize);
    this.observer.disconnect();
    this.clouds.forEach((cloud) => cloud && cloud.dispose());
    this.pictures.dispose();
    this.stage.dispose();
  }
}
