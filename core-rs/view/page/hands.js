// Keys that are played by pointers: mouse, pen and touch. A pointer leads a finger by a spring, and the finger holds the
// key. The page sends where pointers are, and draws what the server sends back: pointer, finger and key.

import { Lane } from "./lane.js";

const RETRY_MS = 1000; // [ms] from a lost connection to the next attempt
const PING_MS = 200; // [ms] between two pings
const PONGS_MAX = 100; // pongs that are compared: those of 20 s, because the clocks drift
const POSITIONS_MAX = 64; // positions in a message
const HEAD_BYTES = 4;
const POSITION_BYTES = 16;
const PICTURE_BYTES = 17; // of a key
const REMEMBERED = "ergon hands"; // keys that this page holds, for when it is loaded again

class Hands {
  constructor(element, keys) {
    this.lanes = keys.map((key, number) => new Lane(element, number, key, (what, rows) => this.send(number, what, rows)));
    this.offset = null; // [s] from this page's clock to the server's
    addEventListener("visibilitychange", () => document.hidden && this.lanes.forEach((lane) => lane.lift()));
    this.open();
  }

  open() {
    const address = new URL("hands", document.baseURI);
    address.protocol = "ws:";
    address.search = "";
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.pongs = [];
    let asking = 0;
    this.socket.onopen = () => {
      this.ask();
      asking = setInterval(() => this.ask(), PING_MS);
      const before = remembered();
      this.lanes.forEach((lane) => before.has(lane.name) && lane.hold());
    };
    this.socket.onmessage = ({ data }) => (typeof data === "string" ? this.receiveText(data) : this.draw(new DataView(data)));
    this.socket.onclose = () => {
      clearInterval(asking);
      this.offset = null;
      this.lanes.forEach((lane) => lane.isLost());
      setTimeout(() => this.open(), RETRY_MS);
    };
  }

  get isOpen() {
    return this.socket.readyState === WebSocket.OPEN;
  }

  ask() {
    if (this.isOpen) this.socket.send(`ping ${performance.now() / 1000}`);
  }

  receiveText(text) {
    const [what, sent, time] = text.split(" ");
    if (what === "taken") this.lanes[Number(sent)]?.isTaken();
    if (what !== "pong") return;
    const now = performance.now() / 1000;
    this.pongs.push({ trip: now - Number(sent), offset: Number(time) - (now + Number(sent)) / 2 });
    if (this.pongs.length > PONGS_MAX) this.pongs.shift();
    // The pong of the shortest round trip gives the best offset.
    this.offset = this.pongs.reduce((best, pong) => (pong.trip <= best.trip ? pong : best)).offset;
  }

  /** Sends positions of key `number`; `what`: "hold", "leave", "move" or "lift". A row is {time [ms], x [m], pressure}. */
  send(number, what, rows = []) {
    if (!this.isOpen) return;
    if (what === "hold" || what === "leave") {
      this.socket.send(`${what} ${number}`);
      remember(this.lanes[number].name, what === "hold");
      return;
    }
    if (this.offset === null) return;
    for (let first = 0; first < rows.length; first += POSITIONS_MAX) {
      const part = rows.slice(first, first + POSITIONS_MAX);
      const view = new DataView(new ArrayBuffer(HEAD_BYTES + POSITION_BYTES * part.length));
      view.setUint8(0, number);
      view.setUint8(1, what === "lift" ? 1 : 0);
      view.setUint16(2, part.length, true);
      part.forEach(({ time, x, pressure }, i) => {
        view.setFloat64(HEAD_BYTES + POSITION_BYTES * i, time / 1000 + this.offset, true);
        view.setFloat32(HEAD_BYTES + POSITION_BYTES * i + 8, x, true);
        view.setFloat32(HEAD_BYTES + POSITION_BYTES * i + 12, pressure, true);
      });
      this.socket.send(view.buffer);
    }
  }

  draw(view) {
    this.lanes.forEach((lane, i) => {
      const from = PICTURE_BYTES * i;
      const [pointer, finger, key, force] = [1, 5, 9, 13].map((byte) => view.getFloat32(from + byte, true));
      lane.take(view.getUint8(from), { pointer, finger, key, force });
    });
  }
}

function remembered() {
  return new Set(JSON.parse(sessionStorage.getItem(REMEMBERED) ?? "[]"));
}

function remember(name, isHeld) {
  const names = remembered();
  if (isHeld) names.add(name);
  else names.delete(name);
  sessionStorage.setItem(REMEMBERED, JSON.stringify([...names]));
}

const element = document.getElementById("hands");
const keys = await (await fetch("hands")).json();
if (keys.length) new Hands(element, keys);
else if (document.body.classList.contains("alone")) element.textContent = "No key waits for a page: begin with --live PLAYER=page:";
