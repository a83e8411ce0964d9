// Sampled positions of a part: chunks of frames that are unpacked when the instant is near, and dropped when it is far.

import { after } from "./events.js";
import { unpack } from "./packed.js";

const UNPACKED_MAX = 8; // unpacked chunks of a part
const UNPACKED_BYTES_MAX = 256 << 20; // bytes of one that is unpacked
const REST = 1.5e-6; // [m] from frame to frame below which a point rests: its steps are then a micrometre at most
const [PLAIN, PACKED] = [0, 1]; // codings

export class Frames {
  constructor(count) {
    this.count = count; // points
    this.chunks = [];
    this.times = [];
    this.unpacked = [];
  }

  take(seconds, view) {
    this.chunks.push({
      seconds,
      coding: view.getUint8(2),
      frames: view.getUint32(4, true),
      hop: view.getFloat64(8, true),
      packed: new Uint8Array(view.buffer, 16),
      rows: null,
    });
    this.times.push(seconds);
  }

  /** The rows of a chunk; none if it is damaged. */
  rows(chunk) {
    if (chunk.rows) return chunk.rows;
    try {
      chunk.rows = rows(chunk, this.count);
    } catch {
      chunk.rows = [];
    }
    this.unpacked.push(chunk);
    if (this.unpacked.length > UNPACKED_MAX) this.unpacked.shift().rows = null;
    return chunk.rows;
  }

  /** The row `k` frames after the beginning of chunk `i`, which may lie in the chunk before or after; else null. */
  row(i, k) {
    const chunk = this.chunks[i];
    const step = k < 0 ? -1 : 1;
    if (k >= 0 && k < chunk.frames) return this.rows(chunk)[k] ?? null;
    const next = this.chunks[i + step];
    const isNext = next && Math.abs(next.seconds - chunk.seconds - (step > 0 ? chunk.frames : -next.frames) * chunk.hop) < chunk.hop / 2;
    return isNext ? this.row(i + step, step > 0 ? k - chunk.frames : k + next.frames) : null;
  }

  /** Displacements at `t` into `out` from `first` on; false if they are unknown. */
  at(t, out, first) {
    const i = after(this.times, t + 1e-9) - 1;
    const chunk = this.chunks[i];
    if (!chunk || !this.rows(chunk).length) return false;
    const since = Math.min(Math.max(0, (t - chunk.seconds) / chunk.hop), chunk.frames);
    const k = Math.min(Math.floor(since + 1e-6), chunk.frames - 1);
    const share = Math.max(0, since - k);
    const [before, row, next, later] = [-1, 0, 1, 2].map((step) => this.row(i, k + step));
    const ends = next ?? this.chunks[i + 1]?.rows?.[0] ?? row; // over a gap in a straight line
    for (let p = 0; p < this.count; p++) {
      out[first + p] = between(share, row[p], ends[p], next && before ? before[p] : NaN, later ? later[p] : NaN);
    }
    return true;
  }

  forget(t) {
    const n = Math.max(0, after(this.times, t) - 1);
    this.chunks.splice(0, n);
    this.times.splice(0, n);
  }
}

/**
 * The displacement at a share of the time from a frame to the next one: on the cubic through both and the frames before
 * and after (NaN: not known), and on a straight line where the point rests.
 */
export function between(share, x, y, before, after) {
  const isStill = (from, to) => Math.abs(to - from) <= REST;
  const straight = x + share * (y - x);
  if (Number.isNaN(before)) {
    if (Number.isNaN(after)) return straight;
    before = 3 * (x - y) + after;
  } else if (Number.isNaN(after)) after = 3 * (y - x) + before;
  if (isStill(x, y) && (isStill(before, x) || isStill(y, after))) return straight;
  const [back, on, far] = [share + 1, share - 1, share - 2];
  return (share * on * (back * after - far * before)) / 6 + (back * far * (on * x - share * y)) / 2;
}

function rows(chunk, n) {
  if (4 * chunk.frames * n > UNPACKED_BYTES_MAX) throw new Error(`${chunk.frames} frames of ${n} points are more than a chunk holds`);
  if (chunk.coding === PACKED) return unpack(chunk.packed, chunk.frames, n);
  if (chunk.coding !== PLAIN) throw new Error(`frames have the coding ${chunk.coding}, which this page does not know`);
  const view = new DataView(chunk.packed.buffer, chunk.packed.byteOffset, chunk.packed.length);
  return Array.from({ length: chunk.frames }, (_, k) => Float32Array.from({ length: n }, (_, p) => view.getFloat32(4 * (k * n + p), true)));
}
