// Free oscillations: the flight of every point and mode at an instant. A flight is e^{−σs}(a cos ωs + b sin ωs).

import { after } from "./events.js";

const RECORD = 12;

export class Flights {
  constructor(count) {
    this.a = new Float64Array(count);
    this.b = new Float64Array(count);
    this.begin = new Float64Array(count); // [s]
    this.states = []; // key states, each with the flights that follow it
    this.times = [];
    this.segment = -1;
    this.done = 0; // flights of the segment that are under way
  }

  takeState(seconds, view) {
    this.states.push({ seconds, view, flights: [] });
    this.times.push(seconds);
  }

  take(seconds, view) {
    if (!this.states.length) this.takeState(seconds, new DataView(new ArrayBuffer(0)));
    this.states.at(-1).flights.push({ seconds, view });
  }

  /** Sets the flights to those of an instant, forwards or backwards. */
  to(t) {
    const segment = Math.max(0, after(this.times, t + 1e-9) - 1);
    const state = this.states[segment];
    if (!state) return;
    const past = segment === this.segment && this.done && state.flights[this.done - 1].seconds > t + 1e-9;
    if (segment !== this.segment || past) {
      this.a.fill(0);
      this.b.fill(0);
      this.set(state.seconds, state.view);
      this.segment = segment;
      this.done = 0;
    }
    while (this.done < state.flights.length && state.flights[this.done].seconds <= t + 1e-9) {
      const { seconds, view } = state.flights[this.done++];
      this.set(seconds, view);
    }
  }

  set(seconds, view) {
    for (let at = 0; at + RECORD <= view.byteLength; at += RECORD) {
      const i = view.getUint32(at, true);
      if (i >= this.a.length) continue;
      this.a[i] = view.getFloat32(at + 4, true);
      this.b[i] = view.getFloat32(at + 8, true);
      this.begin[i] = seconds;
    }
  }

  /** Calls `see(number, a, b)` for every flight that the file holds so far. */
  each(see) {
    for (const { view, flights } of this.states) {
      for (const one of [view, ...flights.map((f) => f.view)]) {
        for (let at = 0; at + RECORD <= one.byteLength; at += RECORD) {
          see(one.getUint32(at, true), one.getFloat32(at + 4, true), one.getFloat32(at + 8, true));
        }
      }
    }
  }

  forget(t) {
    const n = Math.max(0, after(this.times, t) - 1);
    this.states.splice(0, n);
    this.times.splice(0, n);
    this.segment -= n;
  }
}

/** Position of a flight (a, b) after `s` seconds, and the envelope within which it moves, into `out`. */
export function flight(a, b, omega, sigma, s, out) {
  if (a === 0 && b === 0) {
    out.z = out.amplitude = 0; // its decay may be infinite: a point that is struck later has s < 0
    return;
  }
  const fall = Math.exp(-sigma * s);
  if (omega === 0) {
    out.z = fall * (a + b * s);
    out.amplitude = Math.abs(out.z);
    return;
  }
  out.z = fall * (a * Math.cos(omega * s) + b * Math.sin(omega * s));
  out.amplitude = fall * Math.hypot(a, b);
}
