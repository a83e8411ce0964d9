// Cuts the bytes of a `.motion` file into chunks as they arrive; a chunk is used only if its checksum is right.

export const KIND = {
  manifest: 1, points: 2, flights: 3, frames: 4, ergons: 5, contacts: 6, levels: 7, hands: 8,
  clock: 9, state: 10, index: 11, links: 12, shapes: 13, names: 14, peaks: 15, broken: 16,
};

export const MAGIC = [0x45, 0x52, 0x47, 0x4d, 2, 0, 0, 0];
const VERSION = 2;
const HEAD = 16;
const CRC = 4;
const PAYLOAD_MAX = 64 << 20;

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

/** Cuts a stream into chunks, and gives each to `take({kind, seconds, view, bytes})`. */
export class Chunks {
  constructor(take) {
    this.take = take;
    this.pieces = [];
    this.have = 0;
    this.need = MAGIC.length;
    this.begun = false;
  }

  /** Throws an Error with a sentence if the bytes are not a motion file; chunks before them remain valid. */
  push(piece) {
    this.pieces.push(piece);
    this.have += piece.length;
    if (this.have < this.need) return;
    const bytes = this.pieces.length === 1 ? piece : join(this.pieces, this.have);
    const at = this.read(bytes);
    this.pieces = at < bytes.length ? [bytes.subarray(at)] : [];
    this.have = bytes.length - at;
  }

  /** Returns how many bytes were complete chunks; sets `need` to the length of the next chunk, or of its head. */
  read(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
    let at = 0;
    if (!this.begun) {
      if (MAGIC.some((byte, i) => bytes[i] !== byte)) throw new Error(`this is no .motion file of format ${MAGIC[4]}`);
      this.begun = true;
      at = MAGIC.length;
    }
    for (;;) {
      this.need = HEAD + CRC;
      if (bytes.length - at < HEAD) return at;
      const length = view.getUint32(at + 4, true);
      if (length > PAYLOAD_MAX) throw new Error(`a chunk of ${length} bytes is longer than any may be`);
      this.need += length;
      if (bytes.length - at < this.need) return at;
      const end = at + HEAD + length;
      if (crc32(bytes.subarray(at, end)) !== view.getUint32(end, true)) {
        throw new Error("a chunk is damaged: its check sum is another");
      }
      this.one(view, bytes, at, length);
      at = end + CRC;
    }
  }

  one(view, bytes, at, length) {
    const kind = view.getUint16(at, true);
    const version = view.getUint16(at + 2, true);
    if (!Object.values(KIND).includes(kind)) return;
    if (version !== VERSION) throw new Error(`chunks of kind ${kind} have version ${version}; this page knows ${VERSION}`);
    const payload = bytes.slice(at + HEAD, at + HEAD + length); // a copy is aligned, and does not keep the whole buffer alive
    this.take({ kind, seconds: view.getFloat64(at + 8, true), bytes: payload, view: new DataView(payload.buffer) });
  }
}

function join(pieces, length) {
  const all = new Uint8Array(length);
  let at = 0;
  for (const piece of pieces) {
    all.set(piece, at);
    at += piece.length;
  }
  return all;
}
