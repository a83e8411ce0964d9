// One key to play: a lane in which a pointer drags it, with pointer, finger and key as three points, and the spring
// between pointer and finger, whose length and colour show its force.

import { inputsOf } from "./inputs.js";

const [MINE, ANOTHERS] = [1, 2]; // who holds a key; 0: nobody
const MARGIN = 24; // [px] above and below the travel
const COILS = 7;
const STRONG = 5; // [N] at which the spring has its full colour
const CONTACT = 0.5; // [N] by which a force grows from one picture to the next where something is met
const ORDINARY = 0.5; // pressure of a pointer that measures none

export class Lane {
  /** `send(what, rows)` sends what happens to the server. */
  constructor(parent, number, { name, input, low, high }, send) {
    Object.assign(this, { name, low, high, send }); // the ends of its travel [m]
    this.status = null; // who holds the key; null: no connection
    this.points = null;
    this.drag = null; // {id: of the pointer, y [px], x [m], target: where the pointer is [m], isTouch}
    this.input = null; // letters or a stick, beside the pointer
    this.canvas = document.createElement("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("aria-label", `Key of ${name}: drag it up and down`);
    this.words = document.createElement("figcaption");
    this.button = document.createElement("button");
    this.button.textContent = "let go";
    this.button.onclick = () => this.leave();
    const figure = document.createElement("figure");
    figure.append(this.words, this.canvas, this.choice(number, input), this.button);
    parent.append(figure);
    this.listen();
    this.isDirty = true;
    requestAnimationFrame(() => this.draw());
  }

  /** A list of what may play the lane beside a pointer. */
  choice(number, input) {
    const inputs = inputsOf(number);
    const list = document.createElement("select");
    list.setAttribute("aria-label", `What plays the key of ${this.name}`);
    list.append(...inputs.map(([value, words]) => new Option(words, value)));
    list.onchange = () => {
      this.input?.close();
      this.input = inputs[list.selectedIndex][2](this);
      list.blur(); // letters play the lane, and choose nothing here
    };
    list.selectedIndex = Math.max(0, inputs.findIndex(([value]) => value === (input === "keys" ? "letters" : "pointer")));
    list.onchange();
    return list;
  }

  listen() {
    const { canvas } = this;
    canvas.addEventListener("pointerdown", (event) => this.land(event));
    // Raw events come as they happen; others come once a picture.
    const moved = "onpointerrawupdate" in canvas ? "pointerrawupdate" : "pointermove";
    canvas.addEventListener(moved, (event) => this.move(event));
    for (const over of ["pointerup", "pointercancel", "lostpointercapture"])
      canvas.addEventListener(over, (event) => event.pointerId === this.drag?.id && this.lift(event.timeStamp));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  // --- the pointer ---

  land(event) {
    if (this.drag || event.button > 0) return;
    event.preventDefault();
    this.canvas.setPointerCapture(event.pointerId);
    this.hold();
    // The finger lands where the key is, wherever the pointer touches the lane.
    const x = this.points?.key ?? 0;
    this.drag = { id: event.pointerId, y: event.clientY, x, target: x, isTouch: event.pointerType === "touch" };
    this.place([event]);
  }

  move(event) {
    if (event.pointerId !== this.drag?.id) return;
    const events = event.getCoalescedEvents?.() ?? [];
    this.place(events.length ? events : [event]);
  }

  /** Letters or a stick take the lane, with the finger where the key is; false if a pointer has it. */
  beginHere() {
    if (this.drag) return false;
    this.hold();
    this.drag = { id: null, target: this.points?.key ?? 0 };
    return true;
  }

  /** Where the pointer of letters or a stick is, as a share of the travel, at `time` [ms]. */
  target(share, time) {
    if (this.drag?.id !== null) return;
    this.drag.target = this.low + (this.high - this.low) * share;
    this.send("move", [{ time, x: this.drag.target, pressure: ORDINARY }]);
    this.isDirty = true;
  }

  get share() {
    return ((this.drag?.target ?? this.points?.key ?? 0) - this.low) / (this.high - this.low);
  }

  place(events) {
    const { drag } = this;
    const rows = events.map((event) => {
      drag.target = Math.max(this.low, Math.min(this.high, drag.x + (drag.y - event.clientY) / this.scale));
      const pressure = event.pointerType === "pen" && event.pressure > 0 ? event.pressure : ORDINARY;
      return { time: event.timeStamp, x: drag.target, pressure };
    });
    this.send("move", rows);
    this.isDirty = true;
  }

  lift(time = performance.now()) {
    if (!this.drag) return;
    this.send("lift", [{ time, x: this.drag.target, pressure: 0 }]);
    this.drag = null;
    this.isDirty = true;
  }

  hold() {
    if (this.status !== MINE) this.send("hold");
  }

  leave() {
    this.lift();
    this.input?.wasLeft?.();
    this.send("leave");
  }

  // --- what the server sends ---

  take(status, points) {
    const jump = Math.abs(points.force) - Math.abs(this.points?.force ?? 0);
    // A telephone that vibrates tells of contacts, by 10 ms a newton.
    if (this.drag?.isTouch && jump > CONTACT && navigator.userActivation?.hasBeenActive) navigator.vibrate?.(Math.min(40, 10 * jump));
    this.status = status;
    this.points = points;
    this.isDirty = true;
  }

  isTaken() {
    this.drag = null;
    this.status = ANOTHERS;
    this.isDirty = true;
  }

  isLost() {
    this.drag = null;
    this.status = null;
    this.isDirty = true;
  }

  get sentence() {
    if (this.status === null) return "no connection";
    if (this.status === ANOTHERS) return "another page plays it";
    if (this.status !== MINE) return "the stand-in plays: touch to take it";
    if (this.drag && Number.isNaN(this.points.finger)) return "waits for the piece";
    return `${Math.abs(this.points.force).toFixed(1)} N`;
  }

  // --- the picture ---

  /** Pixels of a metre. */
  get scale() {
    return Math.max(1, this.canvas.clientHeight - 2 * MARGIN) / (this.high - this.low);
  }

  draw() {
    requestAnimationFrame(() => this.draw());
    const { canvas } = this;
    const [width, height, ratio] = [canvas.clientWidth, canvas.clientHeight, devicePixelRatio];
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
      this.isDirty = true;
    }
    if (!this.isDirty) return;
    this.isDirty = false;
    const words = `${this.name}: ${this.sentence}`;
    if (this.words.textContent !== words) this.words.textContent = words;
    this.button.disabled = this.status !== MINE;
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const [middle, y] = [width / 2, (x) => MARGIN + (this.high - x) * this.scale];
    pen.fillStyle = "#2a3550";
    pen.fillRect(middle - 1, y(this.high), 2, (this.high - this.low) * this.scale);
    if (!this.points) return;
    const { finger, key, force } = this.points;
    pen.fillStyle = this.status === MINE ? "#e7d9a8" : "#6b7080";
    pen.fillRect(middle - 34, y(key) - 5, 68, 10);
    const pointer = this.drag?.target ?? this.points.pointer;
    if (Number.isNaN(pointer)) return;
    if (!Number.isNaN(finger)) {
      this.spring(pen, middle, y(finger), y(pointer), force);
      pen.fillStyle = "#e39a6f";
      pen.beginPath();
      pen.arc(middle, y(finger), 8, 0, 7);
      pen.fill();
    }
    pen.strokeStyle = "#cfd6e6";
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(middle, y(pointer), 13, 0, 7);
    pen.stroke();
  }

  spring(pen, middle, from, to, force) {
    const strength = Math.min(1, Math.abs(force) / STRONG);
    pen.strokeStyle = `hsl(${210 - 210 * strength} 85% ${55 + 10 * strength}%)`;
    pen.lineWidth = 1.5 + 3 * strength;
    pen.beginPath();
    pen.moveTo(middle, from);
    for (let coil = 1; coil < 2 * COILS; coil++) {
      const side = coil % 2 ? 9 : -9;
      pen.lineTo(middle + side, from + ((to - from) * coil) / (2 * COILS));
    }
    pen.lineTo(middle, to);
    pen.stroke();
  }
}
