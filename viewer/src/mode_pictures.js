// A small moving picture of each mode: the surface in its part of the motion alone, enlarged, drawn
// once on the stage's canvas and played from a strip.

import { Surface } from "./surface.js";

const SIZE = 72;
const N = 16;
// How far a mode moves the surface in its picture, as a share of the surface's size.
const REACH = 0.16;
// Vertices up to which pictures cost little.
const MOST_VERTICES = 60_000;

const STILL = { rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1], drift: [0, 0, 0] };

export class ModePictures {
  constructor(stage, motion, canvases) {
    Object.assign(this, { stage, motion, canvases });
    this.strips = canvases.map(() => null);
    // Without the turn and drift of the whole.
    const alone = Object.create(motion, { poseAt: { value: () => STILL } });
    this.surface = motion.nVertices > MOST_VERTICES ? null : new Surface(alone, "superposed", null);
    this.next = 0;
    if (this.surface) this.timer = setTimeout(() => this.make(), 60);
  }

  // One mode at a time, so that the page stays quick.
  make() {
    const { motion, stage } = this;
    const w = this.next++;
    if (w >= this.canvases.length || stage.isLost) return;
    const path = motion.trajectories()[w];
    const most = Math.max(...path.map(Math.abs));
    const gains = new Float32Array(this.canvases.length);
    gains[w] = most > 0 ? (REACH * stage.radius) / most : 0;
    this.largest = this.largest || [];
    this.largest[w] = Math.round((path.findIndex((x) => Math.abs(x) === most) / Math.max(motion.nFrames, 1)) * N) % N;
    const strip = document.createElement("canvas");
    const pixels = SIZE * stage.ratio;
    strip.width = N * pixels;
    strip.height = pixels;
    const context = strip.getContext("2d");
    for (let k = 0; k < N; k++) {
      this.surface.update(motion.placeAt((k / N) * motion.span), gains, 0, 1);
      stage.renderSmall(this.surface, SIZE);
      const { canvas } = stage;
      context.drawImage(canvas, 0, canvas.height - pixels, pixels, pixels, k * pixels, 0, pixels, pixels);
    }
    this.strips[w] = strip;
    const own = this.canvases[w];
    own.width = own.height = pixels;
    this.drawn = null;
    stage.draw();
    this.timer = setTimeout(() => this.make(), 20);
  }

  // While it plays each picture is at the same share of the motion; at rest at its largest.
  show(share, isPlaying) {
    const now = isPlaying ? Math.floor(share * N) % N : -1;
    if (now === this.drawn) return;
    this.drawn = now;
    this.strips.forEach((strip, w) => {
      if (!strip) return;
      const [own, size] = [this.canvases[w], strip.height];
      const context = own.getContext("2d");
      context.clearRect(0, 0, size, size);
      context.drawImage(strip, (now < 0 ? this.largest[w] : now) * size, 0, size, size, 0, 0, size, size);
    });
  }

  dispose() {
    clearTimeout(this.timer);
    if (this.surface) this.surface.dispose();
  }
}
