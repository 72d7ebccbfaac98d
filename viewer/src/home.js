// The page at /: what this is, a place to drop a file, and the sequences that are there.

import { Refused } from "./api.js";
import { h } from "./dom.js";

const IMAGES = /\.(nii|nii\.gz|nrrd|mha|mhd|dcm)$/i;

const STEPS = [
  ["Signature", "a few amplitudes a frame, with the error that they leave"],
  ["Volume", "over time, and the ejection fraction with its bound"],
  ["Class", "of the motion with a probability, or none where the data do not tell"],
];

export class Home {
  constructor(root, service, open, openImages) {
    Object.assign(this, { service, open, openImages });
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
    this.drop = h(
      "section",
      { class: "drop", "aria-label": "Upload" },
      h("h2", {}, "Drop a moving surface or images here"),
      h("p", {}, "An .npz file with vertices (frames, vertices, 3); or VTKHDF, GLB, a zip of STL, PLY, OBJ or VTK frames. Images over time: NIfTI, NRRD, MetaImage, or a zip of DICOM slices."),
      h("label", { class: "button", for: "file" }, "Choose a file"),
      this.file,
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
        h("header", {}, h("p", { class: "brand" }, "modalmotion"),
          h("h1", {}, "How a surface moves when it does not move rigidly"),
          h("p", { class: "lead" }, "Send a beating ventricle, a tongue, any mesh sequence. Back come a few numbers a frame that say how it moves, and where they are wrong. Look at both, side by side.")),
        this.drop,
        h("ul", { class: "steps" }, STEPS.map(([name, text]) => h("li", {}, h("strong", {}, name), h("span", {}, text)))),
        this.listBox,
        h("footer", {}, h("a", { href: "/docs" }, "All calls of this service"), " · ", h("a", { href: "/openapi.json" }, "OpenAPI document"),
          h("p", { class: "foot" }, "For research and tool development. Not a medical device.")),
      ),
    );
    this.list();
  }

  async send(file) {
    this.progress.hidden = false;
    this.status.textContent = `Sending ${file.name}, ${(file.size / 1e6).toFixed(2)} MB`;
    this.service.onJob = (job) => {
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
        sequence = await this.service.upload(file, tell);
      } catch (error) {
        // A zip without surfaces may hold images; if it does not, that is the lesser news.
        if (!/\.zip$/i.test(file.name) || !(error instanceof Refused)) throw error;
        return await this.sendImages(file, tell).catch(() => Promise.reject(error));
      }
      this.status.textContent = "Fitting the modes";
      await this.open(sequence.id);
    } catch (error) {
      this.progress.hidden = true;
      this.status.textContent = error.message;
    }
  }

  async sendImages(file, tell) {
    const images = await this.service.upload(file, tell, "/v1/images");
    await this.openImages(images.id);
  }

  async list() {
    let page;
    try {
      page = await this.service.json("/v1/sequences?limit=50");
    } catch (error) {
      this.status.textContent = error.message;
      return;
    }
    if (!page.sequences.length) return;
    const rows = page.sequences.map((one) => {
      const link = h("a", { href: `/view/${one.id}`, onclick: (event) => this.go(event, one.id) }, one.subject || one.id.slice(0, 12));
      const cells = [link, one.label || "", one.topology || "", String(one.n_frames), one.n_vertices.toLocaleString("en"), one.unit || "unknown", one.created.slice(0, 16).replace("T", " ")];
      return h("tr", {}, cells.map((cell, i) => h("td", { class: i === 3 || i === 4 ? "number" : "" }, cell)));
    });
    this.table.replaceChildren(...rows);
    this.listBox.replaceChildren(
      h("h2", {}, "Sequences"),
      h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Sequences" },
        h("table", {}, h("thead", {}, h("tr", {}, ["Sequence", "Class", "Surface", "Frames", "Vertices", "Unit", "Received (UTC)"].map((name) => h("th", { scope: "col" }, name)))), this.table)),
    );
    this.listBox.hidden = false;
  }

  async go(event, id) {
    if (event.ctrlKey || event.metaKey || event.shiftKey) return;
    event.preventDefault();
    await this.open(id).catch((error) => (this.status.textContent = error.message));
  }

  dispose() {}
}
