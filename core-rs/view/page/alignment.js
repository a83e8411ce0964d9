// How much earlier the picture is drawn than the sound is computed to be heard: amplifiers, projectors and wireless
// loudspeakers have delays that are not known to the program. The value is kept in a cookie, because a cookie holds for
// all ports of a machine, unlike other storage of a browser.

export const STEP = 0.005; // [s] of a key
const SECONDS_MAX = 1; // [s] either way
const NAME = "ergon-picture-ahead";
const YEAR = 365 * 86400; // [s]

export class Alignment {
  constructor(store = document) {
    this.store = store;
    const found = Number(new RegExp(`(?:^|; )${NAME}=(-?\\d+)`).exec(store.cookie)?.[1] ?? 0);
    this.ahead = bounded(found / 1000); // [s]
  }

  shift(seconds) {
    this.ahead = bounded(this.ahead + seconds);
    this.store.cookie = `${NAME}=${Math.round(1000 * this.ahead)}; max-age=${YEAR}; SameSite=Strict; path=/`;
  }

  /** The setting as text. */
  get told() {
    const ms = Math.round(1000 * this.ahead);
    return ms === 0 ? "picture as it is computed" : `picture ${Math.abs(ms)} ms ${ms > 0 ? "earlier" : "later"}`;
  }
}

function bounded(seconds) {
  return Math.max(-SECONDS_MAX, Math.min(SECONDS_MAX, seconds));
}
