// Labels over the picture: loudspeakers, keys, and parts with their exaggeration. They are elements, so that they can
// be read aloud.

import { project } from "./camera.js";
import { levels } from "./draw.js";

export class Labels {
  constructor(box) {
    this.box = box;
    this.all = [];
    this.shown = true;
  }

  follow(model) {
    if (this.model === model && this.version === model.version) return;
    this.model = model;
    this.version = model.version;
    this.box.replaceChildren();
    this.all = [];
    for (const s of model.speakers) this.add("speaker", s.name, () => s.xyz);
    for (const k of model.keys) this.add("key", k.name, () => [model.x[k.point], model.y[k.point], model.z[k.point]], k.point);
    for (const [name, runs] of instruments(model.parts)) {
      const points = runs.flatMap((i) => Array.from(model.pointsOf(model.parts[i])));
      const { centre } = model.extent(points);
      const edge = Math.min(...runs.map((i) => lowest(model.y, model.parts[i])));
      this.add("part", name, () => [centre[0], edge, centre[2]], model.parts[runs[0]].first, runs);
    }
  }

  add(kind, text, at, point = null, runs = null) {
    const element = document.createElement("span");
    element.className = kind;
    element.textContent = text;
    this.box.append(element);
    this.all.push({ kind, text, at, point, runs, element });
  }

  place(story, motion, t, look, width, height) {
    this.follow(story.model);
    this.box.hidden = !this.shown;
    if (!this.shown) return;
    const now = levels(story, t);
    const taken = [];
    let speaker = 0;
    for (const label of this.all) {
      const [x, y, z] = label.at();
      const at = project(look.matrix, x, y, z, width, height);
      const style = label.element.style;
      const runs = label.runs ?? (label.point === null ? [] : [story.model.partOf[label.point]]);
      const gone = !at || (runs.length && runs.every((i) => look.seen[i] === 0));
      label.element.hidden = gone;
      if (label.kind === "speaker") label.element.dataset.level = now[speaker++].db.toFixed(1);
      if (gone) continue;
      if (label.runs) label.element.textContent = this.words(story.model.parts[label.runs[0]], motion, ...label.runs);
      const free = placed(taken, at, label.element.textContent, width, height);
      if (!free) {
        label.element.hidden = true;
        continue;
      }
      style.transform = `translate(${free.x.toFixed(1)}px, ${free.y.toFixed(1)}px) translate(-50%, 9px)`;
      lead(label.element, free, at);
    }
  }

  /** The name of a part and the factors by which its runs of points are exaggerated. */
  words(part, motion, ...runs) {
    if (part.kind === "none") return `${part.name}: ${WHY[part.why] ?? "not computed"}`;
    const factors = runs.map((i) => motion.exaggeration(i));
    const [smallest, largest] = [Math.min(...factors), Math.max(...factors)];
    const range = smallest === largest ? times(smallest) : `${times(smallest)} to ${times(largest)}`;
    return `${part.name} ${range}${runs.some((i) => motion.locked[i] !== null) ? " locked" : ""}`;
  }
}

/**
 * The runs of points of each instrument, by its name: of several only those that are computed, so that one label names
 * an instrument. Keys have labels of their own.
 */
function instruments(parts) {
  const byName = new Map();
  parts.forEach((part, i) => {
    if (part.layout === "key" || !part.count) return;
    byName.set(part.name, [...(byName.get(part.name) ?? []), i]);
  });
  for (const [name, runs] of byName) {
    const computed = runs.filter((i) => parts[i].kind !== "none");
    if (computed.length) byName.set(name, computed);
  }
  return byName;
}

/** The smallest coordinate of the points of a part. */
function lowest(coordinates, part) {
  return coordinates.subarray(part.first, part.first + part.count).reduce((a, b) => Math.min(a, b));
}

const LETTER = 7; // [px] at the size of the page's words
const LINE = 16; // [px]
const GAP = 2; // [px] between labels that stand beside each other
const FAR = 7; // lines: a label that would be farther from its point is hidden; the pointer still shows it
const TURNS = 12; // directions in which a free place is sought

/** The place of a label [px], as near to its point as it covers none placed before; null if none is free. */
function placed(taken, [x, y], words, width, height) {
  const half = (words.length * LETTER) / 2;
  const covers = (place) => taken.some((other) => Math.abs(other.x - place.x) < half + other.half + GAP && Math.abs(other.y - place.y) < LINE);
  if (x >= 0 && x <= width) x = Math.max(half, Math.min(width - half, x)); // no label is cut at an edge
  const fits = (place) => place.x > half && place.x < width - half && place.y > LINE && place.y < height - 3 * LINE;
  for (let ring = 0; ring <= FAR; ring++) {
    const turns = ring ? TURNS : 1;
    for (let turn = 0; turn < turns; turn++) {
      const angle = (2 * Math.PI * turn) / turns + Math.PI / 2; // below its point first
      const place = { x: x + ring * (LINE + half * Math.min(1, ring / 2)) * Math.cos(angle), y: y + ring * LINE * Math.sin(angle), half };
      if (covers(place) || (ring && !fits(place))) continue;
      taken.push(place);
      return place;
    }
  }
  return null;
}

/** A thin line from a label that is away from its point. */
function lead(element, free, [x, y]) {
  const [across, down] = [x - free.x, y - free.y - 1.5 * LINE];
  const length = Math.hypot(x - free.x, y - free.y) > LINE ? Math.hypot(across, down) : 0;
  element.classList.toggle("led", length > 0);
  element.style.setProperty("--length", `${length.toFixed(1)}px`);
  element.style.setProperty("--angle", `${Math.atan2(down, across).toFixed(4)}rad`);
}

const WHY = {
  unheard: "nobody hears it, so it is not computed",
  unmoved: "nothing moves it",
  frozen: "its sound is read from a frozen part",
};

const LONG = 1e7; // from which on a factor is written by a power of ten

/** `×2,600`, and `×5·10¹⁰`. */
export function times(factor) {
  if (factor >= LONG) {
    const [digits, exponent] = Number(factor.toPrecision(3)).toExponential().split("e+");
    return `×${digits}·10${Array.from(exponent, (digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit]).join("")}`;
  }
  return `×${factor.toLocaleString("en", { maximumSignificantDigits: 3 })}`;
}
