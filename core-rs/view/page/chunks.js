// Cuts the bytes of a `.motion` file into chunks as they arrive; a chunk is used only if its checksum is right.

export const KIND = {
  manifest: 1, points: 2, flights: 3, frames: 4, ergons: 5, contacts: 6, levels: 7, hands: 8,
  clock: 9, state: 10, index: 11, links: 12, shapes: 13, names: 14, peaks: 15, broken: 16, bundle: 18,
};

const NAME = [0x45, 0x52, 0x47, 0x4d]; // "ERGM"
const FORMATS = [2, 3];
const MAGIC = NAME.length + 4;
const VERSION = 2;
const HEAD = 16;
const CRC = 4;
export const PAYLOAD_MAX = 64 << 20;

const TABLE = new Uint32Array(256).map((_, n) => {
  for (let bit = 0; bit < 8; bit++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n >>> 0;
});

/** CRC-32 as in zlib. */
export function crc32(bytes) {
  let c = 0xffffffff;
  for (let i = 0; i < bytes.length; i++) c = TABLE[(c ^ bytes[i]) & 255] ^ (c >>> 8);
  return (c ^ 0xffffffff) >>> 0;
}

/** Whether bytes begin as a motion file or a stream does. */
export function begins(bytes) {
  return NAME.every((byte, i) => bytes[i] === byte) && FORMATS.includes(bytes[NAME.length]) && !bytes[5] && !bytes[6] && !bytes[7];
}

/** A chunk: its kind, its instant [s], its payload, and the byte of the file at which it ends. */
export function chunk(kind, seconds, bytes, end) {
  return { kind, seconds, bytes, end, view: new DataView(bytes.buffer) };
}

/** Cuts a stream into chunks. */
export class Chunks {
  constructor() {
    this.pieces = [];
    this.have = 0;
    this.past = 0; // bytes before them
    this.need = MAGIC;
    this.begun = false;
  }

  /**
   * The chunks that a piece completes, one after the other. Throws an Error with a sentence if the bytes are not a
   * motion file; chunks before them remain valid.
   */
  *cut(piece) {
    this.pieces.push(piece);
    this.have += piece.length;
    if (this.have < this.need) return;
    const bytes = this.pieces.length === 1 ? piece : join(this.pieces, this.have);
    const offset = yield* this.read(bytes);
    this.pieces = offset < bytes.length ? [bytes.subarray(offset)] : [];
    this.have = bytes.length - offset;
    this.past += offset;
  }

  /** Returns how many bytes were complete chunks; sets `need` to the length of the next chunk, or of its head. */
  *read(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
    let offset = 0;
    if (!this.begun) {
      if (!begins(bytes)) throw new Error(`this is no .motion file of format ${FORMATS.join(" or ")}`);
      this.begun = true;
      offset = MAGIC;
    }
    for (;;) {
      this.need = HEAD + CRC;
      if (bytes.length - offset < HEAD) return offset;
      const length = view.getUint32(offset + 4, true);
      if (length > PAYLOAD_MAX) throw new Error(`a chunk of ${length} bytes is longer than any may be`);
      this.need += length;
      if (bytes.length - offset < this.need) return offset;
      const end = offset + HEAD + length;
      if (crc32(bytes.subarray(offset, end)) !== view.getUint32(end, true)) {
        throw new Error("a chunk is damaged: its check sum is another");
      }
      const kind = view.getUint16(offset, true);
      if (isKnown(kind)) {
        const version = view.getUint16(offset + 2, true);
        if (version !== VERSION) throw new Error(`chunks of kind ${kind} have version ${version}; this page knows ${VERSION}`);
        // A copy is aligned, and does not keep the whole buffer alive.
        yield chunk(kind, view.getFloat64(offset + 8, true), bytes.slice(offset + HEAD, end), this.past + end + CRC);
      }
      offset = end + CRC;
    }
  }
}

/** Whether the page knows a kind of chunks. */
export function isKnown(kind) {
  return Object.values(KIND).includes(kind);
}

function join(pieces, length) {
  const all = new Uint8Array(length);
  let offset = 0;
  for (const piece of pieces) {
    all.set(piece, offset);
    offset += piece.length;
  }
  return all;
}
