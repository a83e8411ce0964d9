// Keyboard and pointer: a table of what each key does. Everything can be done with the keyboard.

const TURN = 0.05; // [rad] of a key
const DRAG = 0.005; // [rad/px]
const ALT = 0.06; // of the distance

/** Rows of [keys, description, function]. `app` is the page. */
export function table(app) {
  const { clock, camera, look } = app;
  const step = (n, fine) => () => app.seek(clock.t + n * clock.rate * (fine ? 1 / 60 : 1));
  return [
    [[" "], "run, pause", () => app.play(!clock.runs)],
    [["ArrowLeft"], "back a second", step(-1)],
    [["ArrowRight"], "on a second", step(1)],
    [["Shift+ArrowLeft"], "back a frame", step(-1, true)],
    [["Shift+ArrowRight"], "on a frame", step(1, true)],
    [["Home"], "to the beginning", () => app.seek(0)],
    [["End"], "to the end", () => app.seek(Infinity)],
    [["m"], "next mark", () => app.mark(1)],
    [["M"], "mark before", () => app.mark(-1)],
    [["i"], "loop from here", () => clock.markIn()],
    [["o"], "loop to here", () => clock.markOut()],
    [["u"], "no loop", () => clock.noLoop()],
    [["-"], "slower, down to ×1/1000", () => clock.faster(-1)],
    [["=", "+"], "faster, up to ×1", () => clock.faster(1)],
    [["1", "2", "3", "4", "5", "6", "7", "8", "9"], "views: whole, in the dome, from above, from the side, parts", (key) => app.preset(Number(key) - 1)],
    [["a"], "pan left", () => camera.pan(-ALT, 0)],
    [["d"], "pan right", () => camera.pan(ALT, 0)],
    [["w"], "dive", () => camera.dive(0.1)],
    [["s"], "back out", () => camera.dive(-0.1)],
    [["e"], "pan up", () => camera.pan(0, ALT)],
    [["q"], "pan down", () => camera.pan(0, -ALT)],
    [["Shift+A"], "turn left", () => camera.orbit(-TURN, 0)],
    [["Shift+D"], "turn right", () => camera.orbit(TURN, 0)],
    [["ArrowUp"], "turn up", () => camera.orbit(0, TURN)],
    [["ArrowDown"], "turn down", () => camera.orbit(0, -TURN)],
    [["f"], "follow the next key", () => app.follow(1)],
    [["F"], "follow no key", () => app.follow(0)],
    [["p"], "choose the next part", () => app.choose(1)],
    [["P"], "choose the part before", () => app.choose(-1)],
    [["z"], "this part alone, or all", () => app.solo()],
    [["x"], "hide this part, or show it", () => app.see(0)],
    [["c"], "dim this part, or not", () => app.see(0.25)],
    [["["], "exaggerate this part less", () => app.exaggerate(1 / 2)],
    [["]"], "exaggerate this part more", () => app.exaggerate(2)],
    [["k"], "lock its exaggeration, or not", () => app.lock()],
    [["j"], "next point of this part", () => app.inspect(1)],
    [["J"], "point before", () => app.inspect(-1)],
    [["b"], "brighter, for a projector", () => (look.projector = !look.projector)],
    [["g"], "pictures a second, or not", () => (look.frameRate = !look.frameRate)],
    [["t"], "trails", () => (look.trails = !look.trails)],
    [[","], "ergons fall more slowly", () => app.fall(1 / 1.25)],
    [["."], "ergons fall faster", () => app.fall(1.25)],
    [["n"], "words, or none", () => (app.labels.shown = !app.labels.shown)],
    [[";"], "picture 5 ms later against the sound", () => app.align(-1)],
    [["'"], "picture 5 ms earlier", () => app.align(1)],
    [["l"], "sound, or none", () => app.sound.toggle()],
    [["v"], "levels as text", () => app.listLevels()],
    [["h", "?"], "these keys", () => app.help()],
    [["Escape"], "close", () => app.close()],
  ];
}

export class Controls {
  constructor(app, canvas) {
    this.rows = table(app);
    this.byKey = new Map(this.rows.flatMap(([keys, , does]) => keys.map((key) => [key, does])));
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const shifted = event.shiftKey ? this.byKey.get(`Shift+${event.key}`) : undefined;
      const does = shifted ?? this.byKey.get(event.key);
      if (!does) return;
      event.preventDefault();
      does(event.key);
      app.changed();
    });
    this.pointer(app, canvas);
  }

  pointer(app, canvas) {
    let from = null;
    canvas.addEventListener("pointerdown", (event) => {
      from = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!from) return app.point(event.clientX, event.clientY);
      const [dx, dy] = [event.clientX - from[0], event.clientY - from[1]];
      from = [event.clientX, event.clientY];
      if (event.shiftKey || event.buttons & 6) app.camera.pan((-dx * 1.2) / canvas.clientHeight, (dy * 1.2) / canvas.clientHeight);
      else app.camera.orbit(dx * DRAG, dy * DRAG);
      app.changed();
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (from = null));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      app.camera.dive(-Math.sign(event.deltaY) * 0.08);
      app.changed();
    }, { passive: false });
  }

  /** The help text: one line for each row of keys. */
  help() {
    const name = (key) => ({ " ": "space" })[key] ?? key.replace("Arrow", "");
    const names = (keys) => (keys.length > 4 ? `${keys[0]}–${keys.at(-1)}` : keys.map(name).join(" "));
    const lines = this.rows.map(([keys, words]) => `${names(keys).padEnd(12)} ${words}`);
    return `${lines.join("\n")}\ndrag: turn · Shift+drag: pan · wheel: dive · hover: name`;
  }
}
