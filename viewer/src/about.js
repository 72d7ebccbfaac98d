// What its owner knows of a recording: stated here, sent in one change.

import { h, refill } from "./dom.js";

const UNITS = [["", "unknown"], ["mm", "mm"], ["cm", "cm"], ["m", "m"], ["um", "µm"], ["nm", "nm"]];
const CAVITIES = [
  ["unknown", "not stated"], ["lv", "left ventricle"], ["rv", "right ventricle"], ["la", "left atrium"], ["ra", "right atrium"],
  ["other", "another cavity"], ["none", "no cavity"],
];
const FOLLOWS = [["unknown", "not stated"], ["material", "the tissue"], ["normal_displacement", "the shape only"]];
const SYSTEMS = [["unknown", "not stated"], ["LPS", "LPS (DICOM)"], ["RAS", "RAS (NIfTI)"]];
export const LANDMARKS = [["anterior", "Anterior wall"], ["apex", "Apex"], ["base", "Base"], ["theta_zero", "Zero of theta"]];

// What a note asks for, by its words: the field that it is stated in.
const ASKED = [
  [/theta_zero|zero of theta/i, "theta_zero", "Place the zero of theta"],
  [/anterior|assigned to a wall/i, "anterior", "Place the anterior wall"],
  [/length unit|unit of the sequence|check the unit/i, "unit", "State the unit"],
  [/\btimes\b|interval of frames|in seconds/i, "seconds", "State the seconds per frame"],
  [/cavity \(lv/i, "cavity", "State the cavity"],
  [/tracking=?\s?material|tracking/i, "tracking", "State what the points follow"],
  [/handed|coordinates LPS/i, "coordinates", "State the coordinates"],
];

export const fieldAskedBy = (note) => ASKED.find(([pattern]) => pattern.test(note)) || null;

const text = (id, value, extra = {}) => h("input", { type: "text", id: `about-${id}`, maxlength: 200, autocomplete: "off", value: value || "", ...extra });
const choice = (id, options, value) =>
  h("select", { id: `about-${id}` }, options.map(([name, words]) => h("option", { value: name, selected: name === (value || "") }, words)));

export class About {
  // `record`: as the service describes it; `change(stated)` sends it; `place(name, done)` has a place
  // on the surface chosen, and gives its vertex.
  constructor(record, motion, { change, place, marked }) {
    Object.assign(this, { record, motion, change, place, marked });
    this.landmarks = { ...record.facts.landmarks };
    this.element = h("details", { class: "card about", id: "about" });
    this.build();
  }

  build() {
    const { record, motion } = this;
    const { facts } = record;
    const n = motion.nFrames;
    this.step = motion.times && n > 1 ? motion.times[n - 1] / (n - 1) : null;
    this.rate = facts.period ? 60 / facts.period : null;
    const number = (id, value) => h("input", { type: "number", id: `about-${id}`, min: 0, step: "any", value: value === null ? "" : String(+value.toPrecision(6)) });
    this.fields = {
      name: text("name", record.name),
      subject: text("subject", record.subject),
      label: text("label", record.label),
      unit: choice("unit", UNITS, record.unit),
      seconds: number("seconds", this.step),
      rate: number("rate", this.rate),
      cavity: choice("cavity", CAVITIES, facts.cavity),
      tracking: choice("tracking", FOLLOWS, facts.tracking),
      coordinates: choice("coordinates", SYSTEMS, facts.coordinates),
    };
    const names = {
      name: "Name", subject: "Subject", label: "Stated label", unit: "Unit of lengths", seconds: "Seconds per frame", rate: "or heart rate, per minute",
      cavity: "Cavity", tracking: "The points follow", coordinates: "Axes of space",
    };
    this.status = h("p", { class: "status note", role: "status" });
    this.places = h("div", { class: "places" });
    this.save = h("button", { type: "submit", class: "main" }, "Save");
    refill(this.element,
      h("summary", {}, "About this recording"),
      h("form", { onsubmit: (event) => { event.preventDefault(); this.send(); } },
        h("div", { class: "fields" }, Object.entries(this.fields).map(([name, field]) => h("div", {}, h("label", { for: field.id }, names[name]), field))),
        this.places,
        h("div", { class: "actions" }, this.save, this.status)));
    this.showPlaces();
  }

  showPlaces() {
    refill(this.places, LANDMARKS.map(([name, words]) => {
      const value = this.landmarks[name];
      const isStated = value !== undefined && value !== null;
      return h("div", { class: "place-row" },
        h("span", { class: `dot ${name}` }), h("span", { class: "place-name" }, words, h("span", { class: "soft" }, isStated ? (Array.isArray(value) ? " a point" : ` vertex ${value}`) : " not placed")),
        h("button", { type: "button", id: `about-${name}`, onclick: () => this.choose(name) }, isStated ? "Move" : "Place", h("span", { class: "unseen" }, ` ${words.toLowerCase()}`)),
        isStated ? h("button", { type: "button", "aria-label": `Take the ${words.toLowerCase()} away`, onclick: () => this.set(name, null) }, "×") : null);
    }));
    this.marked(this.landmarks);
  }

  choose(name) {
    this.open();
    const words = LANDMARKS.find(([own]) => own === name)[1];
    this.say("Click on the surface, or turn it with the arrow keys and press Enter. Escape ends this.");
    this.place(words, (vertex) => {
      this.say("");
      if (vertex !== null) this.set(name, vertex);
    });
  }

  set(name, value) {
    this.landmarks[name] = value;
    this.showPlaces();
    this.say("Save to have the results made anew.");
  }

  open(name) {
    this.element.open = true;
    const field = name && document.getElementById(`about-${name}`);
    if (field) field.focus();
    this.element.scrollIntoView({ block: "nearest" });
  }

  // Leads to a field, or has a landmark placed at once.
  lead(name) {
    if (LANDMARKS.some(([own]) => own === name)) this.choose(name);
    else this.open(name);
  }

  // What differs from what is known.
  stated() {
    const { record, fields, motion } = this;
    const stated = {};
    const facts = {};
    for (const name of ["name", "subject", "label"]) {
      const value = fields[name].value.trim() || null;
      if (value !== record[name]) stated[name] = value;
    }
    const unit = fields.unit.value || null;
    if (unit !== record.unit) stated.unit = unit;
    const n = motion.nFrames;
    const own = (field, before) => (field.value === (before === null ? "" : String(+before.toPrecision(6))) ? undefined : field.value === "" ? null : Number(field.value));
    const [seconds, rate] = [own(fields.seconds, this.step), own(fields.rate, this.rate)];
    const step = seconds !== undefined ? seconds : rate && this.step === null ? 60 / rate / n : undefined;
    if (step !== undefined) stated.times = step === null ? null : Array.from({ length: n }, (_, k) => k * step);
    if (rate !== undefined) facts.period = rate ? 60 / rate : null;
    // Frames that are further apart last longer than the cycle that was stated.
    else if (step && record.facts.period) facts.period = null;
    for (const name of ["cavity", "tracking", "coordinates"]) {
      const value = fields[name].value;
      if (value !== record.facts[name]) facts[name] = value === "unknown" ? null : value;
    }
    const landmarks = {};
    for (const [name, value] of Object.entries(this.landmarks)) if (value !== (record.facts.landmarks[name] ?? null)) landmarks[name] = value;
    if (Object.keys(landmarks).length) facts.landmarks = landmarks;
    if (Object.keys(facts).length) stated.facts = facts;
    return stated;
  }

  async send() {
    const stated = this.stated();
    if (!Object.keys(stated).length) return this.say("Nothing has changed.");
    this.save.disabled = true;
    this.say("Saving");
    try {
      await this.change(stated);
    } catch (error) {
      this.say(error.message);
    }
    this.save.disabled = false;
  }

  say(words) {
    this.status.textContent = words;
  }
}
