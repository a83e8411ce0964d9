// The connection to the server: whether it is open, the offset of the server's clock, and the messages. It is opened
// again whenever it is lost.

const RETRY_MS = 1000; // [ms] from a lost connection to the next attempt
const PING_MS = 200; // [ms] between two pings
const PONGS_KEPT = 100; // pongs that are compared: those of 20 s, because the clocks drift

export class Connection {
  /** `takes(bytes)`, `isLost()`, and `isBack(another)`; `another`: whether another server has answered. */
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
    this.answers = []; // pongs; the one of the shortest round trip gives the best offset
    let asking = 0;
    this.socket.onopen = () => {
      this.ask();
      asking = setInterval(() => this.ask(), PING_MS);
      this.fresh = true;
    };
    this.socket.onmessage = ({ data }) => (typeof data === "string" ? this.receiveText(data) : this.does.takes(new Uint8Array(data)));
    this.socket.onclose = () => {
      clearInterval(asking);
      this.does.isLost();
      setTimeout(() => this.open(), RETRY_MS);
    };
  }

  ask() {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(`ping ${performance.now() / 1000}`);
  }

  receiveText(text) {
    const [what, sent, at] = text.split(" ");
    if (what !== "pong") return;
    const now = performance.now() / 1000;
    const trip = now - Number(sent);
    const offset = Number(at) - (now + Number(sent)) / 2;
    if (this.fresh) {
      // The clock of a server starts with the server: if the offset has jumped, another server has answered.
      this.does.isBack(this.offset !== null && Math.abs(offset - this.offset) > 1);
      this.fresh = false;
    }
    this.answers.push({ trip, offset });
    if (this.answers.length > PONGS_KEPT) this.answers.shift();
    this.offset = this.answers.reduce((best, one) => (one.trip <= best.trip ? one : best)).offset;
  }
}
