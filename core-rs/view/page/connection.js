// The line to the server: whether it is there, what its clock says, and what it sends. It is made anew whenever it is lost.

const AGAIN = 1000; // [ms] until it is tried again
const ASK = 200; // [ms] between questions for the time
const KEPT = 100; // answers that are compared: 20 s, for two clocks drift

export class Connection {
  /** `takes(bytes)`, `isLost()`, `isBack(another)`: whether another server has taken the place of the last. */
  constructor({ takes, isLost, isBack }) {
    this.does = { takes, isLost, isBack };
    this.offset = null; // [s] from this page's clock to the server's
    this.open();
  }

  open() {
    const address = new URL("live", document.baseURI);
    address.protocol = "ws:";
    address.search = "";
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.answers = []; // the one of the least round trip says most of the clock
    let asking = 0;
    this.socket.onopen = () => {
      this.ask();
      asking = setInterval(() => this.ask(), ASK);
      this.fresh = true;
    };
    this.socket.onmessage = ({ data }) => (typeof data === "string" ? this.hear(data) : this.does.takes(new Uint8Array(data)));
    this.socket.onclose = () => {
      clearInterval(asking);
      this.does.isLost();
      setTimeout(() => this.open(), AGAIN);
    };
  }

  ask() {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(`ping ${performance.now() / 1000}`);
  }

  hear(text) {
    const [what, sent, at] = text.split(" ");
    if (what !== "pong") return;
    const now = performance.now() / 1000;
    const trip = now - Number(sent);
    const offset = Number(at) - (now + Number(sent)) / 2;
    if (this.fresh) {
      // A server's clock begins with it: one that has jumped back is another's.
      this.does.isBack(this.offset !== null && Math.abs(offset - this.offset) > 1);
      this.fresh = false;
    }
    this.answers.push({ trip, offset });
    if (this.answers.length > KEPT) this.answers.shift();
    this.offset = this.answers.reduce((best, one) => (one.trip <= best.trip ? one : best)).offset;
  }
}
