/** What a stream declares, and the frames that were decoded of it. */
export interface Sequence {
  nFrames: number;
  nVertices: number;
  nFaces: number;
  /** The unit of length, if it is known. */
  unit: "m" | "cm" | "mm" | "um" | "nm" | null;
  isDouble: boolean;
  hasTimes: boolean;
  /** Root mean square of the distances from the original, in the unit of length. */
  rms: number;
  /** The largest of them. */
  maxError: number;
  /** Number of the first frame here. */
  first: number;
  /** x, y, z of each vertex of each frame: frame slow, coordinate fast. */
  positions: Float32Array | Float64Array;
  /** Three vertices of each triangle. */
  faces: Uint32Array;
  /** Seconds, one a frame; null if they are unknown. */
  times: Float64Array | null;
}

export interface Options {
  /** First frame, 0 by default. */
  first?: number;
  /** The frame to stop before; all by default. */
  stop?: number;
  /** Refuse streams that declare more bytes of positions and triangles; 2^31 by default. */
  mostBytes?: number;
}

/** A stream that cannot be decoded: damaged, cut, or of another kind. */
export class StreamError extends Error {
  status: number;
}

export type Decode = (bytes: Uint8Array, options?: Options) => Sequence;

/** Decode a stream; decode.wasm is loaded from beside this module at the first call. */
export function decode(bytes: Uint8Array, options?: Options): Promise<Sequence>;

/** Make a decoder from the bytes of decode.wasm, or a module compiled of them. */
export function decoder(source: BufferSource | WebAssembly.Module): Promise<Decode>;
