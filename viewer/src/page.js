// Three hosts of one module: the pages of the service, a single file, a notebook.

import { BASE, Refused, save } from "./api.js";
import { Calls } from "./calls.js";
import { comparePicker, normCard } from "./compare.js";
import { h } from "./dom.js";
import { Home } from "./home.js";
import { Landmarks } from "./landmarks.js";
import { framesOf } from "./stream.js";
import { nameOf, Viewer } from "./viewer.js";

// What an element of the page holds: base64 of gzip.
const bufferOf = (holder) => {
  const packed = Uint8Array.from(atob(holder.textContent), (c) => c.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
};

// Of a view's address, what the service reads; the rest is the page's own.
const OF_PAGE = ["with", "frame", "colour", "gains", "sent", "data", "draw", "play", "speed"];

function askKey(root) {
  return (isWrong) =>
    new Promise((resolve) => {
      const input = h("input", { type: "password", id: "key", autocomplete: "off", required: true });
      const dialog = h(
        "dialog",
        { class: "key", "aria-labelledby": "key-title" },
        h("form", {
          onsubmit: (event) => {
            event.preventDefault();
            dialog.close();
            dialog.remove();
            resolve(input.value.trim());
          },
        },
          h("h2", { id: "key-title" }, isWrong ? "This key is not known" : "This service asks for a key"),
          h("p", {}, "It is kept in this page's memory only, and is gone when the page is closed. The service's operator gives it out."),
          h("label", { for: "key" }, "Key"),
          input,
          h("button", { type: "submit" }, "Use it")),
      );
      root.append(dialog);
      dialog.showModal();
    });
}

class Pages {
  constructor(root) {
    this.root = root;
    this.calls = new Calls(askKey(document.body));
    addEventListener("popstate", () => this.show());
    this.show();
  }

  show() {
    const [, page, id] = location.pathname.replace(BASE, "").split("/");
    if (page === "view" && id) this.view(id).catch((error) => this.fail(error));
    else if (page === "images" && id) this.images(id).catch((error) => this.fail(error));
    else {
      document.title = "modalmotion";
      this.use(new Home(this.root, this.calls, (sequence) => this.open(sequence), (images, name) => this.open(images, "images", { name })));
    }
  }

  use(page) {
    if (this.current && this.current.dispose) this.current.dispose();
    this.current = page;
    window.modalmotion = page;
  }

  // `about`: what the next page should know, such as the name of the file.
  async open(id, page = "view", about = null) {
    history.pushState(about, "", `${BASE}/${page}/${id}`);
    try {
      await this[page](id.split("?")[0]);
    } catch (error) {
      history.back();
      throw error;
    }
  }

  fail(error) {
    this.root.replaceChildren(
      h("div", { class: "home" }, h("p", { class: "brand" }, "modalmotion"),
        h("h1", {}, error instanceof Refused && error.status === 404 ? "There is no such sequence" : "This cannot be shown"),
        h("p", { class: "lead" }, error.message), h("p", {}, h("a", { href: `${BASE}/` }, "All sequences"))),
    );
  }

  async images(id) {
    const track = new URLSearchParams(location.search).get("track");
    this.use(await Landmarks.at(this.root, this.calls, id, (sequence) => this.open(sequence), track));
    document.title = `${track ? "Contours" : "Landmarks"} · modalmotion`;
  }

  async view(id) {
    const { calls } = this;
    const query = new URLSearchParams(location.search);
    const other = query.get("with");
    const ids = [id, ...(other ? [other] : [])];
    OF_PAGE.forEach((name) => query.delete(name));
    if (!this.root.firstChild) this.root.append(h("p", { class: "loading", role: "status" }, "Loading the surface"));
    const [payloads, records] = await Promise.all([
      Promise.all(ids.map((one) => calls.view(one, query))),
      Promise.all(ids.map((one) => calls.sequence(one))),
    ]);
    const again = (name, value) => {
      const address = new URLSearchParams(location.search);
      for (const own of ["frame", "gains"]) address.delete(own);
      value ? address.set(name, value) : address.delete(name);
      return address.size ? `?${address}` : "";
    };
    const [record] = records;
    const file = (ending) => `${this.current.fileName}${ending}`;
    const report = (type, ending) => async () => save(await calls.report(id, query, type), file(ending));
    const fail = (error) => this.fail(error);
    this.use(null);
    this.current = new Viewer(this.root, payloads, {
      isServed: true,
      titles: records.map((one) => one.name || one.subject || ""),
      record,
      change: async (stated) => {
        const next = await calls.change(id, stated);
        // Another unit or other times are another recording, which the page follows.
        history.replaceState(history.state, "", `${BASE}/view/${next.id}${again("with", other)}`);
        await this.view(next.id);
      },
      frames: (motion, add) => calls.frames(motion, query, add),
      data: async (motion) => (motion.header.is_tracked ? calls.trackData(motion.header.sequence_id) : null),
      report: report("application/pdf", "-report.pdf"),
      fhir: report("application/fhir+json", "-fhir.json"),
      dicom: record.facts.coordinates === "LPS" && record.unit === "mm" ? async () => {
        const instance = await chosenFile();
        if (instance) save(await calls.dicom(id, query, instance), file("-dicom.zip"));
      } : null,
      page: async () => save(await calls.page(id, query), file(".html")),
      remove: () => this.remove(id, nameOf(this.current.header)),
      compare: comparePicker(calls, id, other, (one) => {
        history.pushState(null, "", `${BASE}/view/${id}${again("with", one)}`);
        this.view(id).catch(fail);
      }),
      norms: normCard(calls, id),
      track: {
        slices: (images) => this.open(`${images}?track=${id}`, "images").catch(fail),
        describe: () => calls.track(id),
        picture: (name) => calls.trackPicture(id, name),
      },
      classify: () => calls.classify(id),
      classes: () => calls.classes(id),
    });
    document.title = `${nameOf(this.current.header)} · modalmotion`;
    window.modalmotion = this.current;
  }

  // Deletes a recording, once that is confirmed.
  async remove(id, name) {
    if (!(await confirmed(`Delete ${name}?`, "The recording goes with all its results; this cannot be undone.", "Delete"))) return;
    await this.calls.remove(id);
    history.pushState(null, "", `${BASE}/`);
    this.show();
  }
}

// A question with two answers.
function confirmed(title, words, action) {
  return new Promise((resolve) => {
    const end = (answer) => {
      dialog.close();
      dialog.remove();
      resolve(answer);
    };
    const dialog = h("dialog", { class: "key", "aria-labelledby": "confirm-title" },
      h("h2", { id: "confirm-title" }, title), h("p", {}, words),
      h("div", { class: "row" }, h("button", { type: "button", onclick: () => end(false) }, "Keep it"), h("button", { type: "button", class: "delete", onclick: () => end(true) }, action)));
    dialog.addEventListener("cancel", () => end(false));
    document.body.append(dialog);
    dialog.showModal();
  });
}

// A file of the reader's machine; null where none is chosen.
function chosenFile() {
  return new Promise((resolve) => {
    const input = h("input", { type: "file", id: "instance", hidden: true, onchange: () => { input.remove(); resolve(input.files[0] || null); } });
    input.addEventListener("cancel", () => { input.remove(); resolve(null); });
    document.body.append(input);
    input.click();
  });
}

// A single file: everything stands in the page, with a first view as text, which is seen at once.
async function fromPage(root, holders) {
  const payloads = await Promise.all([...holders].map(bufferOf));
  let viewer = null;
  viewer = new Viewer(root, payloads, {
    frames: async (motion, add) => {
      const number = viewer ? viewer.motions.indexOf(motion) : 0;
      const stream = document.querySelector(`script[data-stream="${number}"]`);
      if (stream) {
        const code = document.querySelector("script[data-decoder]");
        add(await framesOf(await bufferOf(stream), await bufferOf(code), motion));
        return;
      }
      for (const piece of document.querySelectorAll(`script[data-frames="${number}"]`)) {
        add(await bufferOf(piece));
        piece.remove();
        await new Promise((done) => setTimeout(done));
      }
    },
    data: async (motion) => {
      const number = viewer ? viewer.motions.indexOf(motion) : 0;
      const held = document.querySelector(`script[data-points="${number}"]`);
      return held && bufferOf(held);
    },
  });
  window.modalmotion = viewer;
}

// Called by anywidget in a notebook.
// Out of sight it is a picture: a browser has eight to sixteen contexts for all cells together.
function render({ model, el }) {
  const root = h("div", { class: "modalmotion embedded" });
  // Empty cells would all be in sight at once.
  root.style.minHeight = "40rem";
  el.append(root);
  let viewer = null;
  const wake = () => {
    if (viewer) return;
    viewer = new Viewer(
      root,
      [copied(model.get("payload"))],
      {
        frames: async (_, add) => model.get("frames").forEach((piece) => add(copied(piece))),
        data: async () => (model.get("points").byteLength ? copied(model.get("points")) : null),
      },
      true,
    );
  };
  const rest = () => {
    if (!viewer) return;
    if (!viewer.isBuilt) {
      viewer.dispose();
      viewer = null;
      root.replaceChildren();
      return;
    }
    viewer.show();
    const picture = h("img", { src: viewer.canvas.toDataURL(), alt: "The surface, at rest while out of sight" });
    root.style.minHeight = `${root.offsetHeight}px`;
    viewer.dispose();
    viewer.stage.renderer.forceContextLoss();
    viewer = null;
    root.replaceChildren(picture);
  };
  const watch = new IntersectionObserver((entries) => (entries.at(-1).isIntersecting ? wake() : rest()));
  watch.observe(root);
  return () => {
    watch.disconnect();
    if (viewer) viewer.dispose();
  };
}

// A view of the kernel's message, as a buffer of its own that starts at 0.
const copied = (view) => view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength);

const host = document.getElementById("modalmotion");
if (host) {
  const holders = document.querySelectorAll("script[data-payload]");
  if (holders.length) fromPage(host, holders);
  else new Pages(host);
}

export default { render };
