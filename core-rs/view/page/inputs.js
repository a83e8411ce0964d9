// What plays a lane beside a pointer: letters of the keyboard, or a stick of a gamepad. Both say where the pointer of the
// lane is, as a share of the travel from 0, its lower end, to 1.

const STEP_MS = 4; // between two positions
const RISE_MS = 40; // from one letter to the next
const AWAY = 0.15; // of its way: a stick that is pushed so far takes the key
const RUMBLE_MS = 50; // between two forces that a gamepad's motors tell of
const STRONG = 5; // [N] at which they turn fastest
const STALE_MS = 400; // a gamepad's time stamp that is older is not believed

// Rows of the keyboard from low to high, for the first lane, the second and the third; letters as on a US keyboard.
const ROWS = [
  ["KeyA", "KeyS", "KeyD", "KeyF", "KeyG", "KeyH", "KeyJ", "KeyK", "KeyL"],
  ["KeyQ", "KeyW", "KeyE", "KeyR", "KeyT", "KeyY", "KeyU", "KeyI", "KeyO"],
  ["KeyZ", "KeyX", "KeyC", "KeyV", "KeyB", "KeyN", "KeyM", "Comma", "Period"],
];
const ROW_NAMES = ["letters A to L", "letters Q to O", "letters Z to ."];
// Axes and triggers of a gamepad in the standard layout, as shares: where they rest, and how they are read; a stick that
// is pushed away counts down.
const STICKS = {
  lx: [0.5, (pad) => 0.5 + 0.5 * pad.axes[0]],
  ly: [0.5, (pad) => 0.5 - 0.5 * pad.axes[1]],
  rx: [0.5, (pad) => 0.5 + 0.5 * pad.axes[2]],
  ry: [0.5, (pad) => 0.5 - 0.5 * pad.axes[3]],
  lt: [0, (pad) => pad.buttons[6].value],
  rt: [0, (pad) => pad.buttons[7].value],
};

/** Letters move the pointer: one that is pressed pulls the finger to its place, and lifts it when released. */
class Letters {
  constructor(lane, row) {
    Object.assign(this, { lane, row, held: [], from: 0, to: 0, since: 0, timer: 0 });
    this.press = (event) => this.pressed(event);
    this.release = (event) => this.released(event);
    // Before the keys of the page: a letter that plays a lane does nothing else.
    addEventListener("keydown", this.press, true);
    addEventListener("keyup", this.release, true);
  }

  close() {
    removeEventListener("keydown", this.press, true);
    removeEventListener("keyup", this.release, true);
    this.rest(performance.now());
  }

  pressed(event) {
    const place = this.row.indexOf(event.code);
    const isOther = event.ctrlKey || event.altKey || event.metaKey || event.target.closest?.("input, textarea");
    if (place < 0 || isOther) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (event.repeat || this.held.includes(place)) return;
    if (!this.held.length && !this.lane.beginHere()) return;
    this.held.push(place);
    this.aim(event.timeStamp);
  }

  released(event) {
    const place = this.row.indexOf(event.code);
    if (!this.held.includes(place)) return;
    event.stopImmediatePropagation();
    this.held = this.held.filter((other) => other !== place);
    if (this.held.length) this.aim(event.timeStamp);
    else this.rest(event.timeStamp);
  }

  /** Begins the way from where the pointer is to the letter that was pressed last. */
  aim(time) {
    this.from = this.share(time);
    this.to = (this.held.at(-1) + 0.5) / this.row.length;
    this.since = time;
    clearInterval(this.timer);
    this.timer = setInterval(() => this.step(), STEP_MS);
    this.lane.target(this.from, time);
  }

  share(time) {
    if (!this.timer) return this.lane.share;
    const done = Math.min(1, Math.max(0, time - this.since) / RISE_MS);
    return this.from + (this.to - this.from) * done * done * (3 - 2 * done);
  }

  step() {
    const time = Math.min(performance.now(), this.since + RISE_MS);
    this.lane.target(this.share(time), time);
    if (time < this.since + RISE_MS) return;
    clearInterval(this.timer);
    this.timer = 0;
  }

  rest(time) {
    clearInterval(this.timer);
    this.timer = 0;
    if (this.held.length) this.held = [];
    this.lane.lift(time);
  }
}

/** A stick takes the key when it is first moved, and plays it until the lane is let go or the gamepad is unplugged. */
class Stick {
  constructor(lane, rest, read) {
    Object.assign(this, { lane, rest, read, last: null, felt: 0, smooth: 0 });
    this.timer = setInterval(() => this.step(), STEP_MS);
  }

  close() {
    clearInterval(this.timer);
    this.lane.lift();
  }

  step() {
    const pad = [...(navigator.getGamepads?.() ?? [])].find((pad) => pad?.connected);
    if (!pad) {
      if (this.last !== null) this.lane.leave();
      this.last = null;
      return;
    }
    const share = this.read(pad);
    if (!this.lane.drag) {
      if (Math.abs(share - this.rest) < AWAY || !this.lane.beginHere()) return;
      this.last = null;
    }
    this.rumble(pad);
    if (share === this.last) return;
    this.last = share;
    const now = performance.now();
    const isFresh = pad.timestamp <= now && pad.timestamp > now - STALE_MS;
    this.lane.target(share, isFresh ? pad.timestamp : now);
  }

  /** The strong motor hums with the force, the weak one buzzes where it changes. */
  rumble(pad) {
    const now = performance.now();
    if (now < this.felt + RUMBLE_MS) return;
    this.felt = now;
    const force = Math.abs(this.lane.points?.force ?? 0);
    const change = Math.abs(force - this.smooth);
    this.smooth += 0.3 * (force - this.smooth);
    if (force + change < 0.01) return;
    const [strongMagnitude, weakMagnitude] = [force / STRONG, (2 * change) / STRONG].map((x) => Math.min(1, x));
    const asked = pad.vibrationActuator?.playEffect?.("dual-rumble", { duration: 2 * RUMBLE_MS, strongMagnitude, weakMagnitude });
    asked?.catch?.(() => {}); // a gamepad without motors
  }

  /** The lane was let go: the stick takes the key again when it is moved again. */
  wasLeft() {
    this.rest = this.last ?? this.rest;
  }
}

/** The inputs that lane `number` can have: [value, words, maker]. */
export function inputsOf(number) {
  const rows = [["letters", ROW_NAMES[number], (lane) => new Letters(lane, ROWS[number])]].filter(() => number < ROWS.length);
  const sticks = Object.entries(STICKS).map(([name, [rest, read]]) => [`gamepad ${name}`, `gamepad ${name}`, (lane) => new Stick(lane, rest, read)]);
  return [["pointer", "pointer", () => null], ...rows, ...sticks];
}
