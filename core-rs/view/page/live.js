// Live playback: which instant of the piece is heard now, from the server's clock and the `clock` chunks.

export const BACK = 5; // [s] how far back a live piece can be scrubbed
const JUMP_BEYOND = 0.1; // [s] beyond which the picture jumps to what is heard
const CORRECTION = 0.1; // share of the difference that is corrected in a picture: the times of a sound card jitter

export class Live {
  /** `offset()`: the server's clock minus this page's [s]; null if it is not known yet. */
  constructor(offset, alignment) {
    this.offset = offset;
    this.alignment = alignment;
    this.isNow = true; // whether the picture follows the live sound
    this.heard = null; // the newest `clock` chunk
  }

  /** Takes a chunk `clock`: the instant `seconds` of the piece is heard at an instant of the server, at a given speed from then on. */
  take(seconds, view) {
    this.heard = { seconds, server: view.getFloat64(0, true), speed: view.getFloat64(8, true) };
  }

  /** The instant heard at `now` [s] of the page; without a clock, the end of what is known. */
  at(now, end) {
    const offset = this.offset();
    if (!this.heard || offset === null) return end;
    const { seconds, server, speed } = this.heard;
    return seconds + speed * (now + this.alignment.ahead + offset - server);
  }

  /** The instant to draw `step` seconds after `t`: it approaches what is heard, or jumps to it. */
  follow(t, step, now, end) {
    const there = this.at(now, end);
    const away = there - (t + step);
    return Math.abs(away) > JUMP_BEYOND ? there : t + step + CORRECTION * away;
  }
}
