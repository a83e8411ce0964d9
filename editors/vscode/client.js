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
  return path.join(os.tmpdir(), `ergon-${process.getuid()}`, "session.sock");
}

/** What a person is shown of a reply to a line. */
function shown(reply) {
  const said = [(reply.taken ? "" : "not taken: ") + reply.text];
  if (typeof reply.try === "string") said.push(`try: ${reply.try}`);
  return said.concat(reply.lines || []).join("\n");
}

class Client {
  /** `say(text, isError)` shows a text. */
  constructor(say) {
    this.say = say;
    this.socket = null;
    this.number = 0;
    this.asked = new Map();
  }

  /** Join the session at a socket; rejects where none is served there. */
  connect(at) {
    this.leave();
    return new Promise((resolve, reject) => {
      const socket = net.connect(at);
      let rest = "";
      socket.setEncoding("utf8");
      socket.once("connect", () => {
        this.socket = socket;
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
    if (said.ended !== undefined) this.say(`the session has ended: ${said.ended}`, true);
    else if (said.ergon !== undefined) {
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
    if (socket !== null) socket.end();
  }
}

module.exports = { Client, place, shown };
