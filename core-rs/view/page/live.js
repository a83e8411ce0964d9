// What is played now: which instant of the piece is heard, by the server's clock and the chunks that tell it.

export const BACK = 5; // [s] of what was played that can be gone back to
const FAR = 0.1; // [s] beyond which the picture jumps to what is heard
const PULL = 0.1; // of the difference, in a picture: what a card tells of its blocks jitters

export class Live {
  /** `offset()` [s] from this page's clock to the server's; null where it is not known yet. */
  constructor(offset, alignment) {
    this.offset = offset;
    this.alignment = alignment;
    this.isNow = true; // the picture goes with what is heard
    this.heard = null; // the last word about that
  }

  /** A chunk `clock`: `seconds` of the piece are heard at an instant of the server, and go so fast from there on. */
  take(seconds, view) {
    this.heard = { seconds, server: view.getFloat64(0, true), speed: view.getFloat64(8, true) };
  }

  /** What is heard at `now` [s] of the page; where no clock says it, the end of what is known. */
  at(now, end) {
    const offset = this.offset();
    if (!this.heard || offset === null) return end;
    const { seconds, server, speed } = this.heard;
    return seconds + speed * (now + this.alignment.ahead + offset - server);
  }

  /** Goes on from `t` to what is heard `step` seconds later. */
  follow(t, step, now, end) {
    const there = this.at(now, end);
    const away = there - (t + step);
    return Math.abs(away) > FAR ? there : t + step + PULL * away;
  }
}
