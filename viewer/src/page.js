// Three hosts of one module: the pages of the service, a single file, a notebook.

import { Refused, save, Service } from "./api.js";
import { h } from "./dom.js";
import { Home } from "./home.js";
import { Landmarks } from "./landmarks.js";
import { Viewer } from "./viewer.js";

const VIEW = "application/vnd.modalmotion.view";
// Of one piece of frames as sent.
const PIECE_BYTES = 4_000_000;

const bufferOf = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;

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
    this.service = new Service(askKey(document.body));
    addEventListener("popstate", () => this.show());
    this.show();
  }

  show() {
    const [, page, id] = location.pathname.split("/");
    if (page === "view" && id) this.view(id).catch((error) => this.fail(error));
    else if (page === "images" && id) this.images(id).catch((error) => this.fail(error));
    else this.use(new Home(this.root, this.service, (sequence) => this.open(sequence), (images) => this.open(images, "images")));
  }

  use(page) {
    if (this.current && this.current.dispose) this.current.dispose();
    this.current = page;
    window.modalmotion = page;
  }

  async open(id, page = "view") {
    history.pushState(null, "", `/${page}/${id}`);
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
        h("p", { class: "lead" }, error.message), h("p", {}, h("a", { href: "/" }, "All sequences"))),
    );
  }

  async images(id) {
    const track = new URLSearchParams(location.search).get("track");
    this.use(await Landmarks.at(this.root, this.service, id, (sequence) => this.open(sequence), track));
    document.title = `${track ? "Contours" : "Landmarks"} · modalmotion`;
  }

  async view(id) {
    const query = new URLSearchParams(location.search);
    const ids = [id, ...(query.get("with") ? [query.get("with")] : [])];
    OF_PAGE.forEach((name) => query.delete(name));
    const { service } = this;
    const asked = query.size ? `?${query}` : "";
    if (!this.root.firstChild) this.root.append(h("p", { class: "loading", role: "status" }, "Loading the surface"));
    const payloads = await Promise.all(
      ids.map(async (one) => (await service.call(`/v1/sequences/${one}/view${asked}`, { accept: VIEW })).arrayBuffer()),
    );
    const here = `/v1/sequences/${id}`;
    this.use(null);
    this.current = new Viewer(this.root, payloads, {
      isServed: true,
      frames: async (motion, add) => {
        const n = Math.max(1, Math.floor(PIECE_BYTES / (6 * motion.nVertices)));
        for (let first = 0; first < motion.nFrames; first += n) {
          const part = new URLSearchParams(query);
          part.set("first", first);
          part.set("stop", Math.min(first + n, motion.nFrames));
          const path = `/v1/sequences/${motion.header.sequence_id}/view/frames?${part}`;
          add(await (await service.call(path, { accept: VIEW })).arrayBuffer());
        }
      },
      data: async (motion) => {
        if (!motion.header.is_tracked) return null;
        return (await service.call(`/v1/tracks/${motion.header.sequence_id}`, { accept: VIEW })).arrayBuffer();
      },
      page: async () => save(await (await service.call(`${here}/view${asked}`, { accept: "text/html" })).blob(), `${id.slice(0, 12)}.html`),
      track: {
        slices: (images) => this.open(`${images}?track=${id}`, "images").catch((error) => this.fail(error)),
        describe: () => service.json(`/v1/tracks/${id}`),
        picture: async (name) => (await service.call(`/v1/tracks/${id}?picture=${name}`, { accept: "image/png" })).blob(),
      },
      classify: async () => service.json(`${here}/classifications`, { method: "POST", body: "{}", type: "application/json" }),
    });
    document.title = `${this.current.header.title || id.slice(0, 12)} · modalmotion`;
    window.modalmotion = this.current;
  }
}

// A single file: everything stands in the page as base64.
function fromPage(root, holders) {
  const payloads = [...holders].map((holder) => bufferOf(holder.textContent.trim()));
  let viewer = null;
  viewer = new Viewer(root, payloads, {
    frames: async (motion, add) => {
      const number = viewer ? viewer.motions.indexOf(motion) : 0;
      for (const piece of document.querySelectorAll(`script[data-frames="${number}"]`)) {
        add(bufferOf(piece.textContent.trim()));
        piece.remove();
        await new Promise((done) => setTimeout(done));
      }
    },
    data: async (motion) => {
      const number = viewer ? viewer.motions.indexOf(motion) : 0;
      const held = document.querySelector(`script[data-points="${number}"]`);
      return held && bufferOf(held.textContent.trim());
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
    root.style.minHeight = "";
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
    viewer.show();
    const picture = h("img", { src: viewer.canvas.toDataURL(), alt: "The surface, at rest while out of sight" });
    root.style.minHeight = `${root.offsetHeight}px`;
    viewer.dispose();
    viewer.stage.renderer.forceContextLoss();
    viewer = null;
    root.replaceChildren(picture);
  };
  const watch = new IntersectionObserver(([entry]) => (entry.isIntersecting ? wake() : rest()));
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
  if (holders.length) setTimeout(() => fromPage(host, holders));
  else new Pages(host);
}

export default { render };
