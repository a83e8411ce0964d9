// Ergons and contacts, looked up by their instants.

const STEP = 0.25; // [s] of a bucket

/** Events in any order, looked up by interval. */
class Events {
  constructor() {
    this.buckets = new Map();
    this.count = 0;
  }

  add(event) {
    const at = Math.floor(event.t / STEP);
    if (!this.buckets.has(at)) this.buckets.set(at, []);
    this.buckets.get(at).push(event);
    this.count++;
  }

  /** Calls `see` for each event from `from` to `to` [s]. */
  between(from, to, see) {
    for (let at = Math.floor(from / STEP); at <= Math.floor(to / STEP); at++) {
      for (const event of this.buckets.get(at) ?? []) {
        if (event.t >= from && event.t <= to) see(event);
      }
    }
  }

  /** The last event up to `t` that is `wanted`; null if there is none. */
  last(t, wanted) {
    const times = [...this.buckets.keys()].filter((at) => at <= Math.floor(t / STEP)).sort((a, b) => b - a);
    for (const at of times) {
      let found = null;
      for (const event of this.buckets.get(at)) {
        if (event.t <= t && (found === null || event.t > found.t) && wanted(event)) found = event;
      }
      if (found) return found;
    }
    return null;
  }

  /** Forgets what is older than `t`. */
  forget(t) {
    for (const at of this.buckets.keys()) {
      if ((at + 1) * STEP < t) {
        this.count -= this.buckets.get(at).length;
        this.buckets.delete(at);
      }
    }
  }
}

export class Ergons extends Events {
  constructor(model) {
    super();
    this.partOf = model.partOf;
    this.greatest = new Float64Array(model.parts.length); // [N·s] of each part
  }

  take(seconds, view) {
    for (let at = 0; at + 20 <= view.byteLength; at += 20) {
      const part = this.partOf[view.getUint32(at + 4, true)];
      this.greatest[part] = Math.max(this.greatest[part], Math.abs(view.getFloat32(at + 8, true)));
      this.add({
        t: seconds + view.getFloat32(at, true),
        point: view.getUint32(at + 4, true),
        impulse: view.getFloat32(at + 8, true),
        speed: view.getFloat32(at + 12, true),
        source: view.getUint32(at + 16, true),
      });
    }
  }

  /** The impulse of an ergon relative to the greatest of its part. */
  share(ergon) {
    return Math.abs(ergon.impulse) / (this.greatest[this.partOf[ergon.point]] || 1);
  }
}

export class Contacts extends Events {
  constructor() {
    super();
    this.greatest = 0; // [N]
  }

  take(seconds, view) {
    for (let at = 0; at + 12 <= view.byteLength; at += 12) {
      const force = view.getFloat32(at + 8, true);
      this.greatest = Math.max(this.greatest, Math.abs(force));
      this.add({ t: seconds + view.getFloat32(at, true), contact: view.getUint32(at + 4, true), force });
    }
  }
}

/** Broken links, with the instant at which each broke. */
export class Breaks {
  constructor() {
    this.since = new Map(); // by the number of the link [s]
    this.version = 0; // grows with every link
  }

  take(seconds, view) {
    for (let at = 0; at + 8 <= view.byteLength; at += 8) {
      const t = seconds + view.getFloat32(at, true);
      const link = view.getUint32(at + 4, true);
      if (t >= (this.since.get(link) ?? Infinity)) continue; // key states repeat it
      this.since.set(link, t);
      this.version++;
    }
  }

  /** The instant at which each of `n` links broke [s]; 3e38 for unbroken links. */
  all(n) {
    const found = new Float32Array(n).fill(3e38);
    for (const [link, t] of this.since) if (link < n) found[link] = t;
    return found;
  }
}

/** Rows of numbers that hold from one instant to the next. */
export class Rows {
  constructor() {
    this.times = [];
    this.rows = [];
  }

  take(seconds, row) {
    this.times.push(seconds);
    this.rows.push(row);
  }

  /** The row at `t`; null before the first. */
  at(t) {
    const i = after(this.times, t + 1e-9) - 1;
    return i < 0 ? null : this.rows[i];
  }

  forget(t) {
    const n = Math.max(0, after(this.times, t) - 1);
    this.times.splice(0, n);
    this.rows.splice(0, n);
  }
}

/** Number of the rising `times` that are at or before `t`. */
export function after(times, t) {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}
