// A connection to a session: lines of JSON over its socket. It knows nothing of VS Code.
"use strict";

const fs = require("fs");
const net = require("net");
const os = require("os");
const path = require("path");

/** The socket of the user's session. */
function place(environment = process.env) {
  const runtime = environment.XDG_RUNTIME_DIR || "";
  if (path.isAbsolute(runtime) && fs.existsSync(runtime)) {
    return path.join(runtime, "ergon", "session.sock");
  }
  const user = process.getuid ? process.getuid() : os.userInfo().username;
  return path.join(os.tmpdir(), `ergon-${user}`, "session.sock");
}

/** The port and the secrets of a session whose socket is a file (docs/socket.md); null for a socket of Unix. */
function address(at) {
  try {
    return fs.statSync(at).isFile() ? JSON.parse(fs.readFileSync(at, "utf8")) : null;
  } catch {
    return null;
  }
}

/** What a person is shown of a reply to a line. */
function shown(reply) {
  const said = [(reply.taken ? "" : "not taken: ") + reply.text];
  if (typeof reply.try === "string") said.push(`try: ${reply.try}`);
  return said.concat(reply.lines || []).join("\n");
}

const LOOK = 60; // [ms] between two questions what sounds
const SHORTEST = 0.15; // [s] for which a place is lit

/** The places that are lit: each until what is written there has ended. */
class Lit {
  constructor() {
    this.places = [];
  }

  /** Take an answer to `sounding` (null: nothing sounds any more); `now` [ms] is the present. Returns whether anything changed. */
  take(sounding, now) {
    const before = this.places.length;
    if (sounding === null) {
      this.places = [];
      return before > 0;
    }
    this.places = this.places.filter((place) => place.until > now);
    for (const place of sounding.began) {
      const left = Math.max(place.end, place.start + SHORTEST) - sounding.now;
      if (left > 0) this.places.push({ ...place, until: now + 1000 * left });
    }
    return before !== this.places.length || sounding.began.length > 0;
  }

  /** Lines and columns, from 0, of the places in a file; `textAt(line, column, length)` reads the editor's text. */
  ranges(file, textAt) {
    return this.places
      .filter((place) => place.file === file && place.text !== "")
      .map(({ line, column, text }) => ({ line: line - 1, from: column - 1, to: column - 1 + text.length, text }))
      .filter(({ line, from, to, text }) => textAt(line, from, to) === text);
  }
}

class Client {
  /** `say(text, isError)` shows a text; `sounds(sounding)` is called with what has begun to sound, and with null at the end. */
  constructor(say, sounds) {
    this.say = say;
    this.sounds = sounds;
    this.timer = null;
    this.socket = null;
    this.number = 0;
    this.asked = new Map();
  }

  /** Join the session at a socket; rejects where none is served there. */
  connect(at) {
    this.leave();
    return new Promise((resolve, reject) => {
      const port = address(at);
      this.answer = port ? port.answer : undefined;
      const socket = port ? net.connect(port.port, "127.0.0.1") : net.connect(at);
      let rest = "";
      socket.setEncoding("utf8");
      socket.once("connect", () => {
        this.socket = socket;
        if (port) socket.write(port.key + "\n");
        if (this.sounds) this.timer = setInterval(() => this.look(), LOOK);
        resolve();
      });
      socket.once("error", () =>
        reject(new Error(`no session is served at ${at}: ergon repl SCORE --socket begins one`)),
      );
      socket.on("data", (text) => {
        const lines = (rest + text).split("\n");
        rest = lines.pop();
        lines.forEach((line) => this.heard(line));
      });
      socket.on("close", () => {
        if (this.socket === socket) {
          this.socket = null;
          this.endLooks();
          this.say("the session is gone", true);
        }
      });
    });
  }

  /** One line of the session's: the greeting, an answer, or the end. */
  heard(line) {
    let said;
    try {
      said = JSON.parse(line);
    } catch {
      return;
    }
    if (said === null || typeof said !== "object") return;
    const asked = this.asked.get(said.id);
    this.asked.delete(said.id);
    if (asked === "sounding") {
      if (said.error === undefined) this.sounds(said.is);
      else this.endLooks(); // a session of an earlier version
    } else if (said.ended !== undefined) this.say(`the session has ended: ${said.ended}`, true);
    else if (said.ergon !== undefined && said.answer !== this.answer) {
      this.say("another program has taken the port of the session", true);
      this.leave();
    } else if (said.ergon !== undefined) {
      const known = said.ergon === 1;
      this.say(known ? `joined ${said.score}` : "this session speaks another protocol", !known);
    } else if (said.error !== undefined) this.say(String(said.error), true);
    else if (asked === "submit") this.say(shown(said.is), !said.is.taken);
    else if (asked === "panic") this.say("panic: no sound, no force; `release` ends it", true);
  }

  ask(what, fields) {
    if (this.socket === null) {
      this.say("no session is joined", true);
      return;
    }
    this.number += 1;
    this.asked.set(this.number, what);
    this.socket.write(JSON.stringify({ id: this.number, do: what, ...fields }) + "\n");
  }

  /** Ask what sounds, unless the last answer has not come. */
  look() {
    if (![...this.asked.values()].includes("sounding")) this.ask("sounding", {});
  }

  endLooks() {
    clearInterval(this.timer);
    this.timer = null;
    this.asked.clear();
    if (this.sounds) this.sounds(null);
  }

  /** Do a line, or a block of lines as one version. */
  submit(text) {
    this.ask("submit", { text });
  }

  /** Silence and no force, at once. */
  panic() {
    this.ask("panic", {});
  }

  /** Leave; the music goes on. */
  leave() {
    const socket = this.socket;
    this.socket = null;
    this.endLooks();
    if (socket !== null) socket.end();
  }
}

module.exports = { Client, Lit, place, shown };
