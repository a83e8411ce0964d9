// The model: points, links, names, parts, loudspeakers, and mode shapes.

const NONE = 0xffffffff;
const COUNT_MAX = 1 << 22; // points and modes that a page takes

/** Axis of the picture for each axis of a space with 2 or 3 axes: the last is up. */
export const ALONG = { 2: [0, 2], 3: [0, 1, 2] };

/** What a file shows: its manifest, and the tables that come after it. */
export class Model {
  constructor(bytes) {
    Object.assign(this, JSON.parse(new TextDecoder().decode(bytes)));
    const n = this.points;
    if (![n, this.modes].every((many) => Number.isInteger(many) && many >= 0 && many <= COUNT_MAX)) {
      throw new Error(`a model of ${n} points and ${this.modes} modes is none that can be drawn`);
    }
    if (this.parts.some((part) => !(part.first >= 0 && part.count >= 0 && part.first + part.count <= n))) {
      throw new Error("a part has points that the model has not");
    }
    this.n = n;
    this.x = new Float32Array(n);
    this.y = new Float32Array(n);
    this.z = new Float32Array(n); // where a point rests: z + rest of the table
    this.omega = new Float64Array(n + this.modes);
    this.sigma = new Float64Array(n + this.modes);
    this.partOf = new Uint32Array(n);
    this.parts.forEach((part, i) => {
      this.partOf.fill(i, part.first, part.first + part.count);
      part.shapes = []; // of each of its modes: which, and its shape over the part's points
    });
    // Points in space: for each, the points of the file that are its coordinates, axis by axis. The first of them is
    // drawn; for a point on a surface the last, which is a mass of a body.
    this.space ??= [];
    if (!this.space.every((axes) => [2, 3].includes(axes.length) && axes.every((p) => p >= 0 && p < n))) {
      throw new Error("a point in space has coordinates that the model has not");
    }
    this.drawn = Uint32Array.from(range(0, n));
    this.masses = new Map(); // of points on surfaces, by their first coordinates
    for (const axes of this.space) {
      const [first, last] = [axes[0], axes.at(-1)];
      const isOfBody = this.partOf[first] !== this.partOf[last];
      if (isOfBody) this.masses.set(first, last);
      for (const p of axes) this.drawn[p] = isOfBody ? last : first;
    }
    this.links = new Uint32Array(0);
    this.names = [];
    this.version = 0; // grows with every table, so that the drawing is updated
  }

  takePoints(view) {
    const n = view.getUint32(0, true);
    const [x, y, z, rest] = [0, 1, 2, 3].map((i) => new Float32Array(view.buffer, 4 + 4 * n * i, n));
    this.x.set(x);
    this.y.set(y);
    for (let i = 0; i < n; i++) this.z[i] = z[i] + rest[i];
    for (const axes of this.space) {
      const at = [x[axes[0]], y[axes[0]], z[axes[0]]];
      axes.forEach((p, axis) => (at[ALONG[axes.length][axis]] += rest[p]));
      for (const p of axes) [this.x[p], this.y[p], this.z[p]] = at;
    }
    const [omega, sigma] = doubles(view, 4 + 16 * n, 2, n);
    this.omega.set(omega);
    this.sigma.set(sigma);
    this.version++;
  }

  takeLinks(view) {
    const n = view.getUint32(0, true);
    this.links = new Uint32Array(view.buffer, 4, 2 * n).map((p) => this.masses.get(p) ?? p);
    this.version++;
  }

  takeNames(bytes) {
    this.names = new TextDecoder().decode(bytes).split("\n");
    this.names.length = Math.min(this.names.length, this.n);
  }

  takeShapes(view) {
    const part = this.parts[view.getUint16(0, true)];
    const first = view.getUint32(4, true);
    const m = view.getUint32(8, true);
    const n = view.getUint32(12, true);
    const [omega, sigma] = doubles(view, 16, 2, m);
    const half = new Uint16Array(view.buffer, 16 + 16 * m, n * m);
    for (let j = 0; j < m; j++) {
      const shape = new Float32Array(n);
      for (let p = 0; p < n; p++) shape[p] = single(half[p * m + j]);
      this.omega[this.n + first + j] = omega[j];
      this.sigma[this.n + first + j] = sigma[j];
      part.shapes.push({ id: this.n + first + j, shape });
    }
  }

  /** The name of a point; if it has none, its part and number. */
  nameOf(point) {
    const part = this.parts[this.partOf[point]];
    if (this.inSpace(point)) return (this.names[point] || part.name).replace(/\.[xyz]$/, "");
    return this.names[point] || `${part.name}.${point - part.first}`;
  }

  /** Whether a point of the file is a coordinate of a point in space. */
  inSpace(point) {
    this.coordinates ??= new Set(this.space.flat());
    return this.coordinates.has(point);
  }

  /** The place in the score of an ergon; null if it has none. */
  source(number) {
    const found = number === NONE ? undefined : this.sources[number];
    return found ?? null;
  }

  /** Centre and radius [m] of some points; by default of all. */
  extent(points = range(0, this.n)) {
    const low = [Infinity, Infinity, Infinity];
    const high = low.map((v) => -v);
    for (const p of points) {
      [this.x[p], this.y[p], this.z[p]].forEach((v, i) => {
        low[i] = Math.min(low[i], v);
        high[i] = Math.max(high[i], v);
      });
    }
    if (low[0] > high[0]) return { centre: [0, 0, 0], radius: 1 };
    const centre = low.map((v, i) => (v + high[i]) / 2);
    return { centre, radius: Math.max(0.02, Math.hypot(...high.map((v, i) => v - centre[i]))) };
  }

  pointsOf(part) {
    return range(part.first, part.first + part.count);
  }
}

/** Columns of n doubles at an offset that need not be aligned. */
function doubles(view, at, columns, n) {
  const all = new Float64Array(view.buffer.slice(at, at + 8 * n * columns));
  return Array.from({ length: columns }, (_, i) => all.subarray(i * n, (i + 1) * n));
}

function* range(from, to) {
  for (let i = from; i < to; i++) yield i;
}

/** A half-precision number. */
export function single(h) {
  const sign = h & 0x8000 ? -1 : 1;
  const exponent = (h >> 10) & 31;
  const fraction = h & 1023;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (1024 + fraction) * 2 ** (exponent - 25);
}
