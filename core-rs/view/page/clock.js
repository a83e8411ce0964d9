// The instant that is drawn: it runs, stands, runs slower, or repeats a loop. It has no clock of its own: the time is
// given to it.

export const SLOWER = [1, 1 / 2, 1 / 5, 1 / 10, 1 / 20, 1 / 50, 1 / 100, 1 / 200, 1 / 500, 1 / 1000];

export class Clock {
  constructor() {
    this.t = 0; // [s] of the piece
    this.runs = false;
    this.slow = 0; // index in SLOWER
    this.loop = null; // [from, to]
    this.from = null;
    this.lastTime = null;
    this.jumped = false; // whether it was set since the sound last followed it
  }

  get rate() {
    return SLOWER[this.slow];
  }

  /** Time of the page since the last call [s], at most 0.5 s. */
  since(now) {
    const step = this.lastTime === null ? 0 : Math.min(Math.max(0, now - this.lastTime), 0.5);
    this.lastTime = now;
    return step;
  }

  /** Advances to `now` [s] of the page, within the duration of the piece. */
  tick(now, duration) {
    const step = this.since(now);
    if (!this.runs) return;
    this.t += step * this.rate;
    if (this.loop && this.t >= this.loop[1]) {
      this.t = this.loop[0] + ((this.t - this.loop[0]) % (this.loop[1] - this.loop[0]));
      this.jumped = true;
    }
    if (this.t >= duration) {
      this.t = duration;
      this.runs = false;
    }
  }

  seek(t, duration, from = 0) {
    this.t = Math.max(from, Math.min(t, duration));
    this.jumped = true;
  }

  faster(steps) {
    this.slow = Math.max(0, Math.min(SLOWER.length - 1, this.slow - steps));
  }

  /** Begins a loop at the current instant. */
  markIn() {
    this.from = this.t;
    this.loop = null;
  }

  /** Ends the loop at the current instant; does nothing if that is not after its beginning. */
  markOut() {
    const from = this.from ?? 0;
    if (this.t > from) this.loop = [from, this.t];
  }

  noLoop() {
    this.loop = this.from = null;
  }
}

/** Seconds as text, with more digits at a slow rate. */
export function shown(t, rate = 1) {
  const figures = rate >= 0.1 ? 2 : rate >= 0.01 ? 4 : 6;
  return `${t.toFixed(figures)} s`;
}
