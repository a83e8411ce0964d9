// Sampled positions of a part: chunks of frames that are unpacked when the instant is near, and dropped when it is far.

import { after } from "./events.js";

const UNPACKED_MAX = 8; // unpacked chunks of a part
const UNPACKED_BYTES_MAX = 256 << 20; // bytes of one that is unpacked

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
      wait: null,
    });
    this.times.push(seconds);
  }

  /** A promise that the frames around `t` are unpacked; null if they are already. */
  prepare(t) {
    const i = after(this.times, t + 1e-9) - 1;
    const needed = [this.chunks[i], this.chunks[i + 1]].filter((chunk) => chunk && !chunk.rows && chunk.coding !== 0);
    return needed.length ? Promise.all(needed.map((chunk) => this.unpack(chunk))) : null;
  }

  /** Reads frames that are not compressed at once: a live piece is drawn without delay. */
  readPlain(chunk) {
    if (!chunk || chunk.rows || chunk.coding !== 0) return;
    chunk.rows = chunk.frames * (4 + 2 * this.count) <= chunk.packed.length ? plain(chunk, this.count) : [];
    this.keep(chunk);
  }

  keep(chunk) {
    this.unpacked.push(chunk);
    if (this.unpacked.length > UNPACKED_MAX) this.unpacked.shift().rows = null;
  }

  unpack(chunk) {
    chunk.wait ??= rows(chunk, this.count).catch(() => []).then((found) => {
      chunk.rows = found;
      chunk.wait = null;
      this.keep(chunk);
    });
    return chunk.wait;
  }

  /** Displacements at `t` into `out` from `first` on; false if they are unknown, or not unpacked yet. */
  at(t, out, first) {
    const i = after(this.times, t + 1e-9) - 1;
    const chunk = this.chunks[i];
    this.readPlain(chunk);
    this.readPlain(this.chunks[i + 1]);
    if (!chunk?.rows?.length) return false; // not unpacked yet, or damaged
    const at = Math.min(Math.max(0, (t - chunk.seconds) / chunk.hop), chunk.frames);
    const k = Math.min(Math.floor(at + 1e-6), chunk.frames - 1);
    const share = Math.max(0, at - k);
    const row = chunk.rows[k];
    const next = chunk.rows[k + 1] ?? this.chunks[i + 1]?.rows?.[0] ?? row;
    for (let p = 0; p < this.count; p++) out[first + p] = row[p] + share * (next[p] - row[p]);
    return true;
  }

  forget(t) {
    const n = Math.max(0, after(this.times, t) - 1);
    this.chunks.splice(0, n);
    this.times.splice(0, n);
  }
}

async function rows(chunk, n) {
  const length = chunk.frames * (4 + 2 * n);
  if (length > UNPACKED_BYTES_MAX) throw new Error(`${chunk.frames} frames of ${n} points are more than a chunk holds`);
  if (chunk.coding === 1) return unzigzag(chunk, n, await inflate(chunk.packed, length));
  throw new Error(`frames have the coding ${chunk.coding}, which this page does not know`);
}

function plain(chunk, n) {
  const view = new DataView(chunk.packed.buffer, chunk.packed.byteOffset, chunk.packed.length);
  return Array.from({ length: chunk.frames }, (_, k) => {
    const at = k * (4 + 2 * n);
    const scale = view.getFloat32(at, true);
    return Float32Array.from({ length: n }, (_, p) => {
      const q = view.getInt16(at + 4 + 2 * p, true);
      return q === -32768 ? NaN : scale * q;
    });
  });
}

function unzigzag(chunk, n, bytes) {
  const scales = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  return Array.from({ length: chunk.frames }, (_, k) => {
    const scale = scales.getFloat32(4 * k, true);
    const low = 4 * chunk.frames + 2 * n * k;
    const row = new Float32Array(n);
    let q = 0;
    for (let p = 0; p < n; p++) {
      const z = bytes[low + p] | (bytes[low + n + p] << 8);
      q += z & 1 ? -((z + 1) >> 1) : z >> 1;
      row[p] = scale * q;
    }
    return row;
  });
}

/** Unpacks a zlib stream up to a known length; further data are not unpacked. */
async function inflate(packed, length) {
  const reader = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate")).getReader();
  const all = new Uint8Array(length);
  let at = 0;
  for (;;) {
    const { value, done } = await reader.read();
    if (done) break;
    if (at + value.length > length) {
      await reader.cancel();
      throw new Error("frames go on after their end");
    }
    all.set(value, at);
    at += value.length;
  }
  if (at < length) throw new Error("frames end before their end");
  return all;
}
