// Every call of the service that the pages make: addresses stand here and nowhere else.

import { Service } from "./api.js";

const VIEW = "application/vnd.modalmotion.view";
// Of one piece of frames as sent.
const PIECE_BYTES = 4_000_000;

const json = (method, body) => ({ method, body: JSON.stringify(body), type: "application/json" });

export class Calls {
  constructor(askKey) {
    this.service = new Service(askKey);
  }

  // Tells of jobs that are waited for.
  set onJob(tell) {
    this.service.onJob = tell;
  }

  async blob(path, accept, options) {
    return (await this.service.call(path, { accept, ...options })).blob();
  }

  async buffer(path, options) {
    return (await this.service.call(path, { accept: VIEW, ...options })).arrayBuffer();
  }

  // Recordings.
  sequences = () => this.service.json("/v1/sequences?limit=50");
  sequence = (id) => this.service.json(`/v1/sequences/${id}`);
  send = (file, tell) => this.service.upload(file, tell, "/v1/sequences");
  change = (id, stated) => this.service.json(`/v1/sequences/${id}`, json("PATCH", stated));
  remove = (id) => this.service.call(`/v1/sequences/${id}`, { method: "DELETE" });
  sample = () => this.service.json("/v1/sequences/sample", { method: "POST" });

  // Of a signature: `query` are its parameters, as the page's address has them; without any a
  // recording has its usual one, by its own id.
  view = async (id, query) => this.buffer(`${await this.signature(id, query)}/view`);
  page = async (id, query) => this.blob(`${await this.signature(id, query)}/view`, "text/html");
  report = async (id, query, type) => this.blob(`${await this.signature(id, query)}/report`, type);
  dicom = async (id, query, instance) =>
    this.blob(`${await this.signature(id, query)}/dicom`, "application/zip", { method: "POST", body: instance, type: "application/octet-stream" });

  async signature(id, query) {
    if (!query || !query.size) return `/v1/signatures/${id}`;
    const stated = Object.fromEntries(query);
    const { key } = await this.service.json(`/v1/sequences/${id}/signatures`, json("POST", stated));
    return `/v1/signatures/${key}`;
  }

  async frames(motion, query, add) {
    const n = Math.max(1, Math.floor(PIECE_BYTES / (6 * motion.nVertices)));
    const here = await this.signature(motion.header.sequence_id, query);
    for (let first = 0; first < motion.nFrames; first += n)
      add(await this.buffer(`${here}/view?first=${first}&stop=${Math.min(first + n, motion.nFrames)}`));
  }

  // Classes and norms.
  classify = (id) => this.service.json(`/v1/signatures/${id}/classifications`, { method: "POST" });
  classes = (id) => this.service.json(`/v1/signatures/${id}/classifications`);
  norms = () => this.service.json("/v1/norms");
  deviations = async (id, norm) =>
    (await this.service.json(`/v1/norms/${encodeURIComponent(norm)}/deviations`, json("POST", { sequences: [id] }))).deviations[0];

  // Tracks.
  track = (id) => this.service.json(`/v1/tracks/${id}`);
  trackData = (id) => this.buffer(`/v1/tracks/${id}`);
  trackPicture = (id, name) => this.blob(`/v1/tracks/${id}?picture=${name}`, "image/png");
  follow = (query) =>
    this.service.json(`/v1/tracks?${new URLSearchParams(query)}`, { method: "POST", body: "", type: "application/octet-stream", isJob: true });

  // Images.
  sendImages = (file, tell) => this.service.upload(file, tell, "/v1/images");
  images = (id) => this.service.json(`/v1/images/${id}`);
  slices = (id, frame, track) => this.buffer(`/v1/images/${id}?frame=${frame}${track ? `&track=${track}` : ""}`);
}
