// Bundles: chunks of a file in one chunk, deflated. Of all records of a kind first the first byte stands there, then the
// second, and so on (docs/motion.md).

import { KIND, PAYLOAD_MAX, chunk, isKnown } from "./chunks.js";

const UNPACKED_FREE = 16 << 20; // bytes that the bundles of any file may hold, beside a multiple of its length so far
const UNPACKED_RATIO = 32;
const HEAD = 8; // bytes of a group's kind, width and number of chunks
const INSTANT = 8; // bytes of a chunk's seconds
const LENGTH = 4;

/** The bundles of one file. */
export class Bundles {
  constructor() {
    this.unpacked = 0; // bytes
  }

  /** The chunks of a bundle, kind by kind. Throws an Error with a sentence if it is damaged, or holds too much. */
  async open({ bytes, view, end }) {
    const where = `the bundle that ends at byte ${end}`;
    const length = bytes.length < LENGTH ? NaN : view.getUint32(0, true);
    this.unpacked += length;
    if (length > PAYLOAD_MAX || this.unpacked > UNPACKED_FREE + UNPACKED_RATIO * end) {
      throw new Error(`${where} would unpack to ${length} bytes, more than a file of this length may hold`);
    }
    try {
      return groups(await inflate(bytes.subarray(LENGTH), length), end);
    } catch {
      throw new Error(`${where} is damaged`);
    }
  }
}

/** Unpacks a zlib stream of a known length; what would follow is not unpacked. Throws an Error if it is not whole. */
async function inflate(packed, length) {
  const reader = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate")).getReader();
  const all = new Uint8Array(length);
  let offset = 0;
  for (;;) {
    const { value, done } = await reader.read();
    if (done) break;
    if (offset + value.length > length) {
      await reader.cancel();
      throw new Error("it goes on after its end");
    }
    all.set(value, offset);
    offset += value.length;
  }
  if (offset < length) throw new Error("it ends before its end");
  return all;
}

function groups(bytes, end) {
  const view = new DataView(bytes.buffer);
  const found = [];
  let offset = 0;
  const take = (length, width) => {
    if (offset + length > bytes.length) throw new Error("a group goes on after the end");
    const records = joined(bytes.subarray(offset, offset + length), width);
    offset += length;
    return new DataView(records.buffer);
  };
  while (offset < bytes.length) {
    const [kind, width] = [view.getUint16(offset, true), view.getUint16(offset + 2, true)];
    const count = view.getUint32(offset + 4, true);
    if (kind === KIND.bundle || width === 0) throw new Error("no group is like this");
    offset += HEAD;
    const [instants, lengths] = [take(INSTANT * count, INSTANT), take(LENGTH * count, LENGTH)];
    let all = 0;
    for (let i = 0; i < count; i++) all += lengths.getUint32(LENGTH * i, true);
    const payloads = take(all, width).buffer;
    let from = 0;
    for (let i = 0; i < count; i++) {
      const to = from + lengths.getUint32(LENGTH * i, true);
      const seconds = instants.getFloat64(INSTANT * i, true);
      if (isKnown(kind)) found.push(chunk(kind, seconds, new Uint8Array(payloads.slice(from, to)), end));
      from = to;
    }
  }
  return found;
}

/** Records of `width` bytes, of which first all first bytes came, then all second ones; what is left over came last. */
function joined(bytes, width) {
  const records = bytes.slice();
  const count = Math.floor(bytes.length / width);
  for (let place = 0; place < width; place++) {
    for (let i = 0; i < count; i++) records[i * width + place] = bytes[place * count + i];
  }
  return records;
}
