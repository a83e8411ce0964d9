// Everything known of a piece, from its chunks: a whole file, or a live stream as far back as can be scrubbed.

import { KIND } from "./chunks.js";
import { Breaks, Contacts, Ergons, Rows } from "./events.js";
import { Flights } from "./flights.js";
import { Frames } from "./frames.js";
import { BACK } from "./live.js";
import { Model } from "./model.js";

export class Story {
  /** `live`: the live playback, of which only the last seconds are kept; null for a file. */
  constructor(live = null) {
    this.live = live;
    this.model = null;
    this.begins = 0; // [s] beginning of what is known
    this.end = 0; // [s] end of what is known
  }

  begin(bytes) {
    this.model = new Model(bytes);
    this.flights = new Flights(this.model.points + this.model.modes);
    this.frames = this.model.parts.map((part) => new Frames(part.count));
    this.ergons = new Ergons(this.model);
    this.contacts = new Contacts();
    this.breaks = new Breaks();
    this.levels = new Rows();
    this.hands = new Rows();
    this.peaks = new Float32Array(this.model.parts.length); // [m]
    this.loudest = new Float64Array(this.model.parts.length); // [m/s] of free points
    this.largest = new Float64Array(this.model.parts.length); // [m] of free points
    this.begins = this.end = 0;
    this.isBegun = false; // whether a key state has come
  }

  /** Takes a chunk. */
  take(chunk) {
    const { kind, seconds, view, bytes } = chunk;
    if (kind === KIND.manifest) return this.begin(bytes);
    if (!this.model) throw new Error("a motion begins with its manifest; this one does not");
    const does = HANDLERS[kind];
    if (does) does(this, seconds, view, bytes);
    if (kind !== KIND.index) this.end = Math.max(this.end, seconds);
    if (kind === KIND.state && this.live) this.dropPast(seconds);
  }

  get duration() {
    return this.model?.duration ?? this.end;
  }

  /** Updates the largest speed and displacement of the free points of each part. */
  updateLargest(view) {
    const { model } = this;
    for (let at = 0; at + 12 <= view.byteLength; at += 12) {
      const i = view.getUint32(at, true);
      if (i >= model.n) continue;
      const far = Math.hypot(view.getFloat32(at + 4, true), view.getFloat32(at + 8, true));
      const fast = model.omega[i] * far;
      const part = model.partOf[i];
      if (far > this.largest[part] && model.omega[i] > 0) this.largest[part] = far;
      if (fast > this.loudest[part]) this.loudest[part] = fast;
    }
  }

  /** Drops the distant past of a live piece, which has no end. */
  dropPast(seconds) {
    if (!this.isBegun) this.begins = seconds;
    this.isBegun = true;
    if (seconds - BACK <= this.begins) return;
    this.begins = seconds - BACK;
    this.forget(this.begins);
  }

  forget(t) {
    for (const one of [this.flights, this.ergons, this.contacts, this.levels, this.hands, ...this.frames]) one.forget(t);
  }
}

const floats = (view) => new Float32Array(view.buffer, 0, view.byteLength >> 2);

/** Of each key: where it is, and what its gesture asks for [m]. */
function hands(view) {
  const found = new Map();
  for (let at = 0; at + 12 <= view.byteLength; at += 12) {
    const [position, asked] = [4, 8].map((i) => view.getFloat32(at + i, true));
    found.set(view.getUint32(at, true), { position, asked });
  }
  return found;
}

const HANDLERS = {
  [KIND.points]: (s, _, view) => s.model.takePoints(view),
  [KIND.links]: (s, _, view) => s.model.takeLinks(view),
  [KIND.names]: (s, _, view, bytes) => s.model.takeNames(bytes),
  [KIND.shapes]: (s, _, view) => s.model.takeShapes(view),
  [KIND.state]: (s, t, view) => {
    s.updateLargest(view);
    s.flights.takeState(t, view);
  },
  [KIND.flights]: (s, t, view) => {
    s.updateLargest(view);
    s.flights.take(t, view);
  },
  [KIND.frames]: (s, t, view) => s.frames[view.getUint16(0, true)]?.take(t, view),
  [KIND.ergons]: (s, t, view) => s.ergons.take(t, view),
  [KIND.broken]: (s, t, view) => s.breaks.take(t, view),
  [KIND.contacts]: (s, t, view) => s.contacts.take(t, view),
  [KIND.levels]: (s, t, view) => s.levels.take(t, floats(view)),
  [KIND.hands]: (s, t, view) => s.hands.take(t, hands(view)),
  [KIND.clock]: (s, t, view) => s.live?.take(t, view),
  [KIND.peaks]: (s, _, view) => s.peaks.set(floats(view).subarray(0, s.peaks.length)),
  [KIND.index]: (s, _, view) => {
    for (let i = 0; i < s.peaks.length; i++) s.peaks[i] = view.getFloat32(16 + 4 * i, true);
  },
};
