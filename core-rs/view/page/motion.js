// Where every point is drawn at an instant: the position of slow points, the sweep of points that oscillate too fast to
// be seen, and the light.

import { flight } from "./flights.js";
import { ALONG } from "./model.js";

export const STROBE = 25; // [Hz] above which a point is drawn as its sweep
const LIGHT_OCTAVES = 12; // octaves of speed from dark to bright
const SPACE_LIGHT = 0.5; // least light of a point in space: its position already shows its motion
const FAINT = 1e-12; // [m] a displacement too small to be seen, however it is drawn
const DRAWN_SHARE = 0.12; // share of a part's size that its largest displacement is drawn at

export class Motion {
  constructor(story) {
    const n = story.model.n;
    this.story = story;
    this.z = new Float32Array(n); // [m]
    this.aside = [new Float32Array(n), new Float32Array(n)]; // of points in space, along x and y [m]
    this.sweep = new Float32Array(n); // [m]
    this.light = new Float32Array(n); // 0 at rest … 1
    this.sign = new Float32Array(n); // of meshes: −1 … 1
    this.known = story.model.parts.map(() => true);
    this.locked = story.model.parts.map((part) => part.exaggeration);
    this.sizes = story.model.parts.map((part) => story.model.extent(story.model.pointsOf(part)).radius);
    this.whole = story.model.extent().radius;
    this.one = { z: 0, amplitude: 0 };
  }

  /** Computes all points at `t` [s]; `rate`: speed of the picture relative to the piece. */
  at(t, rate) {
    const { story } = this;
    story.flights.to(t);
    this.sweep.fill(0);
    this.sign.fill(0);
    story.model.parts.forEach((part, i) => {
      if (part.kind === "free") this.free(part, i, t, rate);
      else if (part.kind === "modal") this.modal(part, i, t, rate);
      else if (part.kind === "sampled") this.sampled(part, i, t);
    });
    for (const axes of story.model.space) this.inSpace(axes);
  }

  /** Gives all coordinates of a point in space the position of that point. */
  inSpace(axes) {
    const moved = [0, 0, 0];
    let light = 0;
    axes.forEach((p, axis) => {
      moved[ALONG[axes.length][axis]] = this.z[p];
      light = Math.max(light, this.light[p]);
    });
    const isOfBody = this.story.model.masses.has(axes[0]);
    for (const p of axes) {
      [this.aside[0][p], this.aside[1][p], this.z[p]] = moved;
      if (isOfBody) continue; // a body looks as it does by itself
      this.light[p] = Math.max(SPACE_LIGHT, light);
      this.sign[p] = 0;
    }
  }

  /** Where a point is drawn [m]. */
  where(p) {
    const { model } = this.story;
    const gain = this.exaggeration(model.partOf[p]);
    const [x, y] = this.aside;
    return [model.x[p] + gain * x[p], model.y[p] + gain * y[p], model.z[p] + gain * this.z[p]];
  }

  free(part, i, t, rate) {
    const { model, flights, loudest } = this.story;
    const { one } = this;
    for (let p = part.first; p < part.first + part.count; p++) {
      const a = flights.a[p];
      const b = flights.b[p];
      if (a === 0 && b === 0) {
        this.z[p] = this.light[p] = 0;
        continue;
      }
      const omega = model.omega[p];
      flight(a, b, omega, model.sigma[p], t - flights.begin[p], one);
      const fast = strobes(omega, rate);
      this.z[p] = fast ? 0 : one.z;
      if (fast) this.sweep[p] = one.amplitude;
      const share = (one.amplitude * omega) / (loudest[i] || 1);
      this.light[p] = Math.max(0, 1 + Math.log2(share + 1e-12) / LIGHT_OCTAVES);
    }
  }

  modal(part, i, t, rate) {
    const { model, flights, peaks } = this.story;
    const { z, sweep, one } = this;
    const from = part.first;
    z.fill(0, from, from + part.count);
    for (const { id, shape } of part.shapes) {
      const a = flights.a[id];
      const b = flights.b[id];
      if (a === 0 && b === 0) continue;
      flight(a, b, model.omega[id], model.sigma[id], t - flights.begin[id], one);
      if (strobes(model.omega[id], rate)) {
        const square = one.amplitude ** 2;
        for (let p = 0; p < shape.length; p++) sweep[from + p] += square * shape[p] * shape[p];
      } else {
        for (let p = 0; p < shape.length; p++) z[from + p] += one.z * shape[p];
      }
    }
    for (let p = from; p < from + part.count; p++) sweep[p] = Math.sqrt(sweep[p]);
    this.mesh(part, peaks[i]);
  }

  sampled(part, i, t) {
    const { frames, peaks } = this.story;
    this.known[i] = frames[i].at(t, this.z, part.first);
    for (let p = part.first; p < part.first + part.count; p++) {
      if (!Number.isFinite(this.z[p])) this.z[p] = 0;
    }
    this.mesh(part, peaks[i]);
  }

  mesh(part, peak) {
    const full = peak || 1;
    for (let p = part.first; p < part.first + part.count; p++) {
      const share = (Math.abs(this.z[p]) + this.sweep[p]) / full;
      this.light[p] = Math.min(1, Math.sqrt(share));
      this.sign[p] = Math.max(-1, Math.min(1, (4 * this.z[p]) / full));
    }
  }

  /** Factor with which the displacement of a part is drawn. */
  exaggeration(i) {
    return this.locked[i] ?? this.automatic(i);
  }

  /** The factor from the largest displacement so far, in steps of 1, 2, 5, so that it seldom changes. */
  automatic(i) {
    const peak = Math.max(this.story.peaks[i], this.story.largest[i]);
    if (!(peak > FAINT)) return 1;
    const size = Math.max(this.sizes[i], 0.15 * this.whole);
    return Math.max(1, rounded((DRAWN_SHARE * size) / peak));
  }

  lock(i, factor) {
    this.locked[i] = factor;
  }
}

/** Whether an oscillation is too fast to be seen, at a rate of the picture. */
function strobes(omega, rate) {
  return omega * rate > 2 * Math.PI * STROBE;
}

/** The largest of 1, 2, 5, 10 … that is not above x. */
export function rounded(x) {
  const ten = 10 ** Math.floor(Math.log10(x) + 1e-9);
  const step = [5, 2, 1].find((s) => s * ten <= x * (1 + 1e-9)) ?? 1;
  return step * ten;
}
