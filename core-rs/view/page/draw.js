// Draws one instant.

import { contactFlash, held, spark } from "./flashes.js";
import { Buffer, PointTexture, Program } from "./gl.js";
import { SHADERS } from "./shaders.js";

const STYLE = { bank: 0, loose: 0, string: 1, plate: 1, key: 2 };
const TRAIL = 6; // earlier instants that are drawn as a trail
const TRAIL_STEP = 1 / 40; // [s] of the picture between them
const HIDDEN = -3; // value of light that marks a hidden point
const SPARK = 3.2; // radii [px of 720 lines]
const CONTACT = 26;
const CROWD = 2; // contacts at once that are drawn at full size; if there are more, each is smaller
// Least brightness of points and of lines, and least radius [px] of points. At rest a point has 3 : 1 or more against the
// background (WCAG 2.2, 1.4.11), for a projector 4.5 : 1 (1.4.3).
const LEAST = { screen: { lift: 0.42, net: 0, smallest: 2 }, projector: { lift: 0.62, net: 0.3, smallest: 3 } };
const KEY_GAP = 0.8; // of the distance to the next key, so that keys stay apart

export class Drawing {
  constructor(gl) {
    this.gl = gl;
    this.programs = Object.fromEntries(Object.entries(SHADERS).map(([name, text]) => [name, new Program(gl, text)]));
    this.quad = new Buffer(gl, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]));
    this.links = new Buffer(gl);
    this.brokenSince = new Buffer(gl);
    this.sparkPoints = new Buffer(gl);
    this.sparkValues = new Buffer(gl);
    this.discs = new Buffer(gl);
    this.lines = new Buffer(gl);
    this.version = -1;
    this.show = { points: true, links: true, sparks: true, contacts: true, speakers: true };
    this.sparks = 0; // number drawn in the last picture
  }

  /** Uploads points and links if the model or its tables are new. */
  follow(model) {
    if (this.model === model && this.version === model.version) return;
    this.rest?.delete();
    this.state?.delete();
    this.rest = new PointTexture(this.gl, 0, model.n);
    this.state = new PointTexture(this.gl, 1, model.n);
    const looks = model.parts.map((part) => 1024 * (STYLE[part.layout] ?? 0) + apart(model, part));
    for (let p = 0; p < model.n; p++) {
      this.rest.data.set([model.x[p], model.y[p], model.z[p], looks[model.partOf[p]]], 4 * p);
    }
    this.rest.put();
    this.links.put(model.links.length ? model.links : new Uint32Array(2));
    this.dome = domeLines(model.speakers);
    this.lines.put(this.dome.length ? this.dome : new Float32Array(3));
    this.model = model;
    this.version = model.version;
  }

  /**
   * Draws a story at t. `look`: matrix, fall [m/s], rate, seen (of each part: 1, dim, 0 hidden), trails, strobe.
   */
  instant(story, motion, t, look) {
    const { gl } = this;
    const { model } = story;
    this.follow(model);
    const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
    this.always = { M: look.matrix, view: [width / 2, height / 2], px: height / 720, rest: { unit: 0 }, state: { unit: 1 }, gain: 1, whole: motion.whole, ...LEAST[look.projector ? "projector" : "screen"] };
    this.clear();
    if (look.trails) {
      for (let k = TRAIL; k > 0; k--) {
        motion.at(Math.max(0, t - k * TRAIL_STEP * look.rate), look.rate);
        this.stand(model, motion, look.seen);
        this.points(model, 0.35 * (1 - k / (TRAIL + 1)));
      }
    }
    motion.at(t, look.rate);
    this.stand(model, motion, look.seen);
    if (this.show.links) this.drawLinks(story, t);
    if (this.show.points) this.points(model, 1);
    this.drawFlashes(story, motion, t, look, width, height);
    if (this.show.speakers) this.drawSpeakers(story, t);
  }

  clear() {
    const { gl } = this;
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.clearColor(0.012, 0.016, 0.03, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_COLOR); // screen blending: overlapping points get brighter slowly
    gl.disable(gl.DEPTH_TEST);
  }

  black() {
    const { gl } = this;
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  /** How every point stands, to the graphics card. */
  stand(model, motion, seen) {
    const { data } = this.state;
    model.parts.forEach((part, i) => {
      const gain = motion.exaggeration(i);
      const dark = part.kind === "none" || !motion.known[i];
      for (let p = part.first, at = 4 * part.first; p < part.first + part.count; p++, at += 4) {
        data[at] = gain * motion.z[p];
        data[at + 1] = gain * motion.sweep[p];
        data[at + 2] = seen[i] === 0 || model.drawn[p] !== p ? HIDDEN : seen[i] * (dark ? 0.02 : motion.light[p]);
        data[at + 3] = motion.sign[p];
      }
    });
    this.state.put();
    if (model.space.length) this.standInSpace(model, motion);
  }

  /** Points in space move along all axes: along x and y their places do. */
  standInSpace(model, motion) {
    const { data } = this.rest;
    for (const axes of model.space) for (const p of axes) data.set(motion.where(p).slice(0, 2), 4 * p);
    this.rest.put();
  }

  points(model, gain) {
    const { gl } = this;
    this.programs.points.use({ ...this.always, gain });
    this.quad.attribute(0, 2);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, model.n);
  }

  drawLinks({ model, breaks }, t) {
    const { gl } = this;
    if (!model.links.length) return;
    this.followBreaks(model, breaks);
    this.programs.links.use({ ...this.always, gain: 0.8, t });
    this.links.attribute(0, 2, { each: 1, integers: true });
    this.brokenSince.attribute(1, 1, { each: 1 });
    gl.drawArraysInstanced(gl.LINES, 0, 2, model.links.length / 2);
    gl.vertexAttribDivisor(0, 0);
    this.release();
  }

  /** Since when links are broken, where more of them are or their table is new. */
  followBreaks(model, breaks) {
    const now = [model, model.version, breaks, breaks.version];
    if (this.breaks?.every((one, i) => one === now[i])) return;
    this.brokenSince.put(breaks.all(model.links.length / 2));
    this.breaks = now;
  }

  /** Ergons and contacts, which share what may flash. */
  drawFlashes(story, motion, t, look, width, height) {
    const px = height / 720;
    const sparks = this.show.sparks ? this.sparksAt(story, motion, t, look, px) : { points: [], values: [], radii: [] };
    const contacts = this.show.contacts && !look.still ? contactsAt(story, motion, t, px) : { at: [], radii: [], share: 1 };
    const hold = look.strobe ? 1 : held([...sparks.radii, ...contacts.radii], width, height);
    this.sparks = sparks.points.length;
    if (sparks.points.length) this.drawSparks(sparks, look, hold);
    if (contacts.at.length) this.drawDiscs(new Float32Array(contacts.at), { size: CONTACT * contacts.share * hold, far: 0, dark: [0, 0, 0], bright: [1, 0.9, 0.7] });
  }

  sparksAt(story, motion, t, look, px) {
    const { model, ergons } = story;
    const { matrix: m, reach } = look;
    const found = { points: [], values: [], radii: [] };
    ergons.between(t - 0.3 * reach, t + reach, (e) => {
      const p = e.point;
      if (p >= model.n || look.seen[model.partOf[p]] === 0) return;
      const depth = m[3] * model.x[p] + m[7] * model.y[p] + m[11] * model.z[p] + m[15];
      const near = Math.min(5, Math.max(0.7, (2.3 * motion.whole) / Math.max(depth, 1e-9)));
      const d = e.t - t;
      const { size, light } = spark(look.still && d < 0.1 * reach ? 0.1 * reach : d, reach, ergons.share(e));
      if (light <= 0) return;
      const radius = px * near * SPARK * size;
      found.points.push(model.drawn[p]);
      found.values.push(d, e.impulse, radius, light);
      found.radii.push(radius);
    });
    return found;
  }

  drawSparks({ points, values }, look, hold) {
    const { gl } = this;
    this.sparkPoints.put(new Uint32Array(points));
    this.sparkValues.put(new Float32Array(values));
    this.programs.sparks.use({ ...this.always, fall: look.fall / look.rate, reach: look.reach, hold });
    this.quad.attribute(0, 2);
    this.sparkPoints.attribute(1, 1, { each: 1, integers: true });
    this.sparkValues.attribute(2, 4, { each: 1 });
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, points.length);
    this.release();
  }

  drawSpeakers(story, t) {
    const { gl } = this;
    const { speakers } = story.model;
    if (!speakers.length) return;
    const now = levels(story, t);
    const at = new Float32Array(4 * speakers.length);
    speakers.forEach((s, i) => at.set([...s.xyz, now[i].share], 4 * i));
    if (this.dome.length) {
      this.programs.lines.use({ ...this.always, dark: [0.05, 0.07, 0.1] });
      this.lines.attribute(0, 3);
      gl.drawArrays(gl.LINES, 0, this.dome.length / 3);
    }
    const far = Math.hypot(...speakers[0].xyz);
    this.drawDiscs(at, { size: 18, far, dark: [0.13, 0.17, 0.22], bright: [0.4, 1, 0.65] });
  }

  drawDiscs(at, how) {
    const { gl } = this;
    this.discs.put(at);
    this.programs.discs.use({ ...this.always, ...how });
    this.quad.attribute(0, 2);
    this.discs.attribute(1, 4, { each: 1 });
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, at.length / 4);
    this.release();
  }

  /** Attributes of instances are none of the next program's. */
  release() {
    for (const at of [1, 2]) {
      this.gl.vertexAttribDivisor(at, 0);
      this.gl.disableVertexAttribArray(at);
    }
  }
}

/** About how far apart the points of a part are, or a key and the one beside it [m]. */
function apart(model, part) {
  if (part.layout === "key") return KEY_GAP * nearestKey(model, part);
  const { radius } = model.extent(model.pointsOf(part));
  if (part.count < 2) return 1;
  const share = part.layout === "string" ? 2 / part.count : Math.sqrt(Math.PI / part.count);
  return Math.min(1000, radius * share);
}

/** From a key to the nearest other one, at most 1 m. */
function nearestKey(model, part) {
  const at = (p) => [model.x[p], model.y[p], model.z[p]];
  const others = model.keys.filter((key) => key.point !== part.first);
  return Math.min(1, ...others.map((key) => Math.hypot(...at(key.point).map((x, i) => x - at(part.first)[i]))));
}

function contactsAt(story, motion, t, px) {
  const { model, contacts } = story;
  // A contact that stays closed is reported at every look: it is drawn as one flash, as bright as the brightest of
  // them.
  const flashes = new Map();
  contacts.between(t - 0.2, t, (c) => {
    const flash = contactFlash(t - c.t, Math.abs(c.force) / (contacts.greatest || 1));
    if (model.contacts[c.contact] && flash > (flashes.get(c.contact) ?? 0)) flashes.set(c.contact, flash);
  });
  const share = Math.min(1, Math.sqrt(CROWD / flashes.size));
  const found = { at: [], radii: [], share };
  for (const [contact, flash] of flashes) {
    const place = touched(model, motion, model.contacts[contact]);
    if (!place) continue;
    found.at.push(...place, flash);
    found.radii.push(px * CONTACT * share);
  }
  return found;
}

/** Where a contact is drawn [m]: between the two, and of a key, which stands apart, at what it touches; null where no end is seen. */
function touched({ keys }, motion, { a, b }) {
  const isKey = (point) => keys.some((key) => key.point === point);
  const ends = [a, b].filter((point) => point !== null);
  const bodies = ends.filter((point) => !isKey(point));
  const at = (bodies.length ? bodies : ends).map((point) => motion.where(point));
  if (!at.length) return null;
  return [0, 1, 2].map((i) => at.reduce((sum, place) => sum + place[i], 0) / at.length);
}

/** Of each loudspeaker: its level [dB re full scale], and that as a share from 0 (−60 dB) to 1. */
export function levels(story, t) {
  const row = story.levels.at(t);
  return story.model.speakers.map((_, i) => {
    const db = 20 * Math.log10((row?.[i] ?? 0) + 1e-12);
    return { db, share: Math.max(0, Math.min(1, 1 + db / 60)) };
  });
}

/** Rings of loudspeakers of one elevation. */
function domeLines(speakers) {
  const rings = new Map();
  for (const s of speakers) {
    const el = Math.round(s.el);
    if (!rings.has(el)) rings.set(el, []);
    rings.get(el).push(s);
  }
  const lines = [];
  for (const ring of rings.values()) {
    if (ring.length < 3) continue;
    ring.sort((a, b) => a.az - b.az);
    ring.forEach((s, i) => lines.push(...s.xyz, ...ring[(i + 1) % ring.length].xyz));
  }
  return new Float32Array(lines);
}
