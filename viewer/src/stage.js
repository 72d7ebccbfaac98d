// One canvas for all panels: each is a window of it, drawn with the same camera.

import { Color, Matrix4, PerspectiveCamera, Vector3, WebGLRenderer } from "three";
import { makeSurfaces } from "./surface.js";

// Numbers summed a frame up to which JavaScript is as fast, and shades smoothly.
const MOST_SUMMED = 600_000;
const SOFTWARE = /swiftshader|llvmpipe|software|basic render/i;

export class Stage {
  constructor(canvas, draw) {
    this.canvas = canvas;
    this.panels = [];
    this.yaw = 0.55;
    this.pitch = 0.28;
    this.zoom = 1;
    [this.wide, this.low, this.top, this.radius] = [0, 0, 0, 1];
    this.wanted = new URLSearchParams(location.search).get("draw");
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.renderer.autoClear = false;
    const gl = this.renderer.getContext();
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : gl.getParameter(gl.RENDERER);
    this.isSoftware = SOFTWARE.test(name);
    this.camera = new PerspectiveCamera(28, 1, 0.01, 100);
    this.camera.matrixAutoUpdate = true;
    this.draw = draw;
    this.isLost = false;
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.isLost = true;
    });
    canvas.addEventListener("webglcontextrestored", () => {
      this.isLost = false;
      this.draw();
    });
    this.listen();
  }

  // Surfaces of a sequence, made as suits the machine.
  surfaces(motion) {
    const summed = motion.nVertices * motion.nModes;
    const inShader =
      this.wanted === "shader" || (this.wanted !== "sum" && !this.isSoftware && summed > MOST_SUMMED);
    // A cylinder about the upright axis holds the surface however it is turned.
    const { rest, header: { view } } = motion;
    let wide = 0;
    for (let i = 0; i < rest.length; i += 3) {
      const [x, y, z] = [0, 1, 2].map((k) => rest[i] * view[0][k] + rest[i + 1] * view[1][k] + rest[i + 2] * view[2][k]);
      wide = Math.max(wide, Math.hypot(x, y));
      this.low = Math.min(this.low, z);
      this.top = Math.max(this.top, z);
    }
    this.wide = Math.max(this.wide, 1.06 * wide);
    this.radius = Math.hypot(this.wide, this.high) || 1;
    return makeSurfaces(motion, inShader);
  }

  // Half of the height, and its middle.
  get high() {
    return 0.53 * (this.top - this.low);
  }

  get middle() {
    return (this.top + this.low) / 2;
  }

  // Pixels of the canvas for one of the page.
  get ratio() {
    return Math.min(devicePixelRatio, this.isSoftware ? 1 : 2);
  }

  render() {
    if (this.isLost) return;
    const { renderer, canvas } = this;
    const box = canvas.getBoundingClientRect();
    if (!box.width || !box.height) return;
    renderer.setPixelRatio(this.ratio);
    renderer.setSize(box.width, box.height, false);
    renderer.setScissorTest(false);
    renderer.setClearColor(new Color(0, 0, 0), 0);
    renderer.clear();
    renderer.setScissorTest(true);
    for (const { surface, element, isShown } of this.panels) {
      if (!isShown) continue;
      const own = element.getBoundingClientRect();
      const [x, y] = [own.left - box.left, box.bottom - own.bottom];
      renderer.setViewport(x, y, own.width, own.height);
      renderer.setScissor(x, y, own.width, own.height);
      this.look(own.width / own.height);
      renderer.render(surface.scene, this.camera);
    }
    renderer.setScissorTest(false);
  }

  // A surface alone in the lower left corner of the canvas, to be copied from there.
  renderSmall(surface, size) {
    const { renderer, canvas } = this;
    const { yaw, pitch, zoom } = this;
    [this.yaw, this.pitch, this.zoom] = [0.55, 0.28, 1.3];
    renderer.setPixelRatio(this.ratio);
    renderer.setSize(Math.max(canvas.clientWidth, size), Math.max(canvas.clientHeight, size), false);
    renderer.setScissorTest(true);
    renderer.setViewport(0, 0, size, size);
    renderer.setScissor(0, 0, size, size);
    renderer.setClearColor(new Color(0, 0, 0), 0);
    renderer.clear();
    this.look(1);
    renderer.render(surface.scene, this.camera);
    renderer.setScissorTest(false);
    [this.yaw, this.pitch, this.zoom] = [yaw, pitch, zoom];
  }

  look(aspect) {
    const half = Math.tan((this.camera.fov * Math.PI) / 360);
    const flat = Math.cos(this.pitch);
    const tall = this.high * flat + this.wide * Math.abs(Math.sin(this.pitch));
    const near = this.wide * flat + this.high * Math.abs(Math.sin(this.pitch));
    const distance = (Math.max(tall / half, this.wide / (half * aspect)) + 0.6 * near || 1) / this.zoom;
    this.camera.position.set(
      distance * Math.sin(this.yaw) * flat,
      this.middle + distance * Math.sin(this.pitch),
      distance * Math.cos(this.yaw) * flat,
    );
    this.camera.aspect = aspect;
    this.camera.near = Math.max(distance - 4 * this.radius, distance / 100);
    this.camera.far = distance + 4 * this.radius;
    this.camera.lookAt(0, this.middle, 0);
    this.camera.updateProjectionMatrix();
  }

  // From a position to pixels of a panel and the depth there.
  projection({ surface }, { width, height }) {
    this.look(width / height);
    this.camera.updateMatrixWorld();
    const whole = new Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse).multiply(surface.object.matrix);
    const at = new Vector3();
    return (x, y, z) => {
      at.set(x, y, z).applyMatrix4(whole);
      return [((at.x + 1) / 2) * width, ((1 - at.y) / 2) * height, at.z];
    };
  }

  // Directions of x, y and z of the file on the screen, for the small cross of axes.
  axes(view) {
    this.look(1);
    this.camera.updateMatrixWorld();
    const turn = new Matrix4().extractRotation(this.camera.matrixWorldInverse);
    return [0, 1, 2].map((k) => {
      const v = new Vector3(view[k][0], view[k][2], -view[k][1]).applyMatrix4(turn);
      return [v.x, -v.y];
    });
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(Math.max(this.pitch + pitch, -1.55), 1.55);
    this.draw();
  }

  near(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.2), 40);
    this.draw();
  }

  reset() {
    [this.yaw, this.pitch, this.zoom] = [0.55, 0.28, 1];
    this.draw();
  }

  listen() {
    const { canvas } = this;
    const touches = new Map();
    let spread = 0;
    canvas.addEventListener("pointerdown", (event) => {
      touches.set(event.pointerId, [event.clientX, event.clientY]);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = touches.get(event.pointerId);
      if (!before) return;
      touches.set(event.pointerId, [event.clientX, event.clientY]);
      if (touches.size === 2) {
        const [a, b] = [...touches.values()];
        const now = Math.hypot(a[0] - b[0], a[1] - b[1]);
        if (spread) this.near(now / spread);
        spread = now;
        return;
      }
      this.turn((before[0] - event.clientX) / 160, (event.clientY - before[1]) / 160);
    });
    for (const name of ["pointerup", "pointercancel"])
      canvas.addEventListener(name, (event) => {
        touches.delete(event.pointerId);
        spread = 0;
      });
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.near(Math.exp(-event.deltaY / 600));
      },
      { passive: false },
    );
    const keys = {
      ArrowLeft: () => this.turn(-0.1, 0),
      ArrowRight: () => this.turn(0.1, 0),
      ArrowUp: () => this.turn(0, 0.1),
      ArrowDown: () => this.turn(0, -0.1),
      "+": () => this.near(1.12),
      "=": () => this.near(1.12),
      "-": () => this.near(1 / 1.12),
      Home: () => this.reset(),
    };
    canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      keys[event.key]();
    });
  }

  dispose() {
    this.panels.forEach(({ surface }) => surface.dispose());
    this.renderer.dispose();
  }
}
