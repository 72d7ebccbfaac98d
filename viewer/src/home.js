// The page at /: a place to drop a file, a sample heart, and the recordings that are there.

import { BASE, Refused } from "./api.js";
import { classSentence } from "./class_card.js";
import { nameOfRecord } from "./compare.js";
import { h, probability } from "./dom.js";
import { worker } from "./head.js";

const IMAGES = /\.(nii|nii\.gz|nrrd|mha|mhd|dcm)$/i;

export class Home {
  constructor(root, calls, open, openImages) {
    Object.assign(this, { calls, open, openImages });
    this.status = h("p", { class: "status", role: "status" });
    this.progress = h("progress", { max: 1, value: 0, hidden: true, "aria-label": "Upload" });
    this.file = h("input", {
      type: "file",
      id: "file",
      "aria-label": "Choose a file of a moving surface, or of images",
      onchange: () => this.file.files[0] && this.send(this.file.files[0]),
    });
    this.table = h("tbody");
    this.listBox = h("section", { class: "list", hidden: true });
    const say = (words) => (this.status.textContent = words);
    this.drop = h(
      "section",
      { class: "drop", "aria-label": "Upload" },
      h("h2", {}, "Drop a moving surface or images here"),
      h("p", {}, "Meshes over time: .npz, VTKHDF, GLB, or a zip of STL, PLY, OBJ or VTK frames. Images over time: NIfTI, NRRD, MetaImage, or a zip of DICOM slices; segmentations too."),
      h("div", { class: "row centred" },
        h("label", { class: "button main", for: "file" }, "Choose a file"),
        this.file,
        worker("Sample heart", () => this.sample(), "A simulated left ventricle, made now", say)),
      this.progress,
      this.status,
    );
    for (const name of ["dragenter", "dragover"])
      this.drop.addEventListener(name, (event) => {
        event.preventDefault();
        this.drop.classList.add("over");
      });
    this.drop.addEventListener("dragleave", () => this.drop.classList.remove("over"));
    this.drop.addEventListener("drop", (event) => {
      event.preventDefault();
      this.drop.classList.remove("over");
      if (event.dataTransfer.files[0]) this.send(event.dataTransfer.files[0]);
    });
    root.replaceChildren(
      h(
        "div",
        { class: "home" },
        // As the service writes it into the first page, where it stands before the script is there.
        document.getElementById("welcome").content.cloneNode(true),
        this.drop,
        this.listBox,
        h("footer", {}, h("a", { href: "/docs" }, "All calls of this service"), " · ", h("a", { href: "/openapi.json" }, "OpenAPI document"),
          h("p", { class: "foot" }, "For research and tool development. Not a medical device.")),
      ),
    );
    this.list();
  }

  async sample() {
    this.status.textContent = "Simulating a ventricle";
    const { id } = await this.calls.sample();
    this.status.textContent = "Fitting the modes";
    await this.open(id);
  }

  async send(file) {
    this.progress.hidden = false;
    this.status.textContent = `Sending ${file.name}, ${(file.size / 1e6).toFixed(2)} MB`;
    this.calls.onJob = (job) => {
      this.status.textContent = job.text || "Reading the file";
    };
    try {
      const tell = (share) => {
        this.progress.value = share;
        if (share === 1) this.status.textContent = "Reading the file";
      };
      if (IMAGES.test(file.name)) return await this.sendImages(file, tell);
      let sequence;
      try {
        sequence = await this.calls.send(file, tell);
      } catch (error) {
        // A zip without surfaces may hold images; if it does not, that is the lesser news.
        if (!/\.zip$/i.test(file.name) || !(error instanceof Refused)) throw error;
        return await this.sendImages(file, tell).catch(() => Promise.reject(error));
      }
      // In a change and not in an address, which may be logged.
      if (!sequence.name) await this.calls.change(sequence.id, { name: file.name.slice(0, 200) });
      this.status.textContent = "Fitting the modes";
      await this.open(sequence.id);
    } catch (error) {
      this.progress.hidden = true;
      this.status.textContent = error.message;
    }
  }

  async sendImages(file, tell) {
    const images = await this.calls.sendImages(file, tell);
    await this.openImages(images.id, file.name.slice(0, 200));
  }

  async list() {
    let page;
    try {
      page = await this.calls.sequences();
    } catch (error) {
      this.status.textContent = error.message;
      return;
    }
    if (!page.sequences.length) return;
    const rows = page.sequences.map((one) => {
      const link = h("a", { href: `${BASE}/view/${one.id}`, onclick: (event) => this.go(event, one.id) }, nameOfRecord(one));
      const label = h("td", { class: "model-class" }, "–");
      this.classOf(one.id, label);
      return h("tr", {},
        h("th", { scope: "row" }, link, one.name || one.subject ? h("span", { class: "soft id" }, ` ${one.id.slice(0, 8)}`) : null),
        h("td", {}, one.name && one.subject ? one.subject : "–"),
        label,
        h("td", {}, one.label || "–"),
        h("td", { class: "number" }, String(one.n_frames)),
        h("td", {}, one.unit || "(unknown)"),
        h("td", {}, one.created.slice(0, 16).replace("T", " ")));
    });
    this.table.replaceChildren(...rows);
    this.listBox.replaceChildren(
      h("h2", {}, "Recordings"),
      h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Recordings" },
        h("table", {}, h("thead", {}, h("tr", {}, ["Recording", "Subject", "Class (model)", "Stated label", "Frames", "Unit", "Received (UTC)"].map((name) => h("th", { scope: "col" }, name)))), this.table)),
    );
    this.listBox.hidden = false;
  }

  // The last answer of a model that is kept.
  async classOf(id, cell) {
    try {
      const { classifications } = await this.calls.classes(id);
      const answer = classifications[classifications.length - 1];
      if (!answer) return;
      const [label, rest] = classSentence(answer);
      cell.textContent = answer.label === null ? label : `${label} (${probability(answer.probability)})`;
      cell.title = label + rest;
    } catch {
      // Whatever is wrong with one answer, the list is there.
    }
  }

  async go(event, id) {
    if (event.ctrlKey || event.metaKey || event.shiftKey) return;
    event.preventDefault();
    await this.open(id).catch((error) => (this.status.textContent = error.message));
  }

  dispose() {}
}
