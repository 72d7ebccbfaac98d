// Decodes a moving surface that modalmotion encoded: bytes to positions, triangles and times.
//
// The work is done by decode.wasm, which is compiled from the sources of the Python package's library
// and gives the same bits. Each stream gets an instance, and memory, of its own.

const N_FACTS = 32;
const ROOM = 17;
const PAGE = 65536;
const UNITS = [null, "m", "cm", "mm", "um", "nm"];

const REASONS = {
  1: "The range coder cannot have written these words.",
  2: "A block holds fewer bits than its values need.",
  3: "A face names a vertex that does not exist.",
  4: "A vertex is numbered that does not exist.",
  5: "A number does not end.",
  6: "It is larger than can be decoded.",
  32: "The bytes are not an encoded sequence.",
  33: "The stream is of a version that this decoder does not read.",
  34: "The stream is cut, or goes on behind its end.",
  35: "A checksum is wrong: the stream is damaged.",
  36: "The stream declares what no encoder writes.",
  37: "The decoded vertices are not those that were encoded.",
  38: "The stream holds its positions without loss; only the Python package decodes those.",
};

export class StreamError extends Error {
  constructor(status) {
    super(REASONS[status] ?? `The decoder gave the status ${status}.`);
    this.name = "StreamError";
    this.status = status;
  }
}

const aligned = (at) => Math.ceil(at / 16) * 16;

class Call {
  constructor(module, bytes) {
    this.code = new WebAssembly.Instance(module).exports;
    const base = aligned(this.code.__heap_base.value);
    this.facts = base;
    this.needed = base + 8 * N_FACTS;
    this.data = this.needed + 16;
    this.size = bytes.length;
    this.require(this.data + this.size);
    new Uint8Array(this.memory, this.data, this.size).set(bytes);
    this.check(this.code.mm_inspect(this.data, this.size, this.facts));
    const [nFrames, nVertices, nFaces, isDouble, unit, hasTimes, rms, maxError] = this.doubles(this.facts, N_FACTS);
    this.header = { nFrames, nVertices, nFaces, isDouble: isDouble === 1, unit: UNITS[unit] ?? null, hasTimes: hasTimes > 0, rms, maxError };
  }

  get memory() {
    return this.code.memory.buffer;
  }

  require(end) {
    const more = end - this.memory.byteLength;
    if (more > 0) this.code.memory.grow(Math.ceil(more / PAGE));
  }

  check(status) {
    if (status) throw new StreamError(status);
  }

  doubles(at, count) {
    return new Float64Array(this.memory, at, count);
  }

  run(first, stop) {
    const { nVertices, nFaces, isDouble, hasTimes } = this.header;
    const n = stop - first;
    const positions = aligned(this.data + this.size);
    const faces = aligned(positions + 3 * n * nVertices * (isDouble ? 8 : 4));
    const times = aligned(faces + 12 * nFaces);
    const work = aligned(times + 8 * n);
    for (let room = 1 << 24, status = ROOM; status === ROOM; ) {
      this.require(work + room);
      status = this.code.mm_decode(this.data, this.size, first, n, positions, faces, times, work, room, this.needed);
      if (status !== ROOM) this.check(status);
      room = Math.max(2 * room, this.doubles(this.needed, 1)[0]);
    }
    return {
      ...this.header,
      first,
      positions: new (isDouble ? Float64Array : Float32Array)(this.memory, positions, 3 * n * nVertices).slice(),
      faces: new Uint32Array(this.memory, faces, 3 * nFaces).slice(),
      times: hasTimes ? this.doubles(times, n).slice() : null,
    };
  }
}

const MOST_BYTES = 2 ** 31;

function decodeWith(module, bytes, { first = 0, stop, mostBytes = MOST_BYTES } = {}) {
  const call = new Call(module, bytes);
  const { nFrames, nVertices, nFaces, isDouble } = call.header;
  const end = stop ?? nFrames;
  if (!(Number.isInteger(first) && Number.isInteger(end) && 0 <= first && first < end && end <= nFrames))
    throw new RangeError(`The frames ${first} to ${end} are not in a stream of ${nFrames}.`);
  const size = 3 * (end - first) * nVertices * (isDouble ? 8 : 4) + 12 * nFaces;
  if (size > mostBytes)
    throw new RangeError(`The stream declares ${size} bytes of positions and triangles, over ${mostBytes}.`);
  return call.run(first, end);
}

// A decoder of a module that was loaded by other means, such as bytes within a page.
export async function decoder(source) {
  const module = source instanceof WebAssembly.Module ? source : await WebAssembly.compile(source);
  return (bytes, options) => decodeWith(module, bytes, options);
}

let own = null;

async function load() {
  const place = new URL("decode.wasm", import.meta.url);
  if (place.protocol === "file:" && typeof process !== "undefined") {
    const { readFile } = await import("node:fs/promises");
    return decoder(await readFile(place));
  }
  const answer = await fetch(place);
  if (!answer.ok) throw new Error(`decode.wasm was answered with ${answer.status}.`);
  return decoder(await answer.arrayBuffer());
}

export async function decode(bytes, options) {
  own ??= load().catch((error) => {
    own = null;
    throw error;
  });
  return (await own)(bytes, options);
}
