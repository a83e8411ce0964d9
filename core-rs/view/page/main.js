// The page: reads the options in its address, loads the piece, and draws one instant after the other.

import { Alignment, STEP } from "./alignment.js";
import { Bundles } from "./bundle.js";
import { Camera, presets, project } from "./camera.js";
import { Chunks, KIND, begins } from "./chunks.js";
import { Clock, shown } from "./clock.js";
import { Connection } from "./connection.js";
import { Controls } from "./controls.js";
import { Drawing, levels } from "./draw.js";
import { context } from "./gl.js";
import { describe, pick } from "./inspector.js";
import { Labels, times } from "./labels.js";
import { Live } from "./live.js";
import { Motion } from "./motion.js";
import { Sound } from "./sound.js";
import { Story } from "./story.js";
import { Timeline } from "./timeline.js";
import { tour } from "./tour.js";

const asked = new URLSearchParams(location.search);
const element = (id) => document.getElementById(id);

class Page {
  constructor(gl, canvas, isLive) {
    this.canvas = canvas;
    this.drawing = new Drawing(gl);
    this.alignment = new Alignment();
    this.live = isLive ? new Live(() => this.connection?.offset ?? null, this.alignment) : null;
    this.story = new Story(this.live);
    this.begun = new Promise((resolve) => (this.hasBegun = resolve)); // a live piece can be drawn
    this.clock = new Clock();
    this.camera = new Camera();
    this.labels = new Labels(element("labels"));
    this.stage = asked.has("stage");
    this.look = {
      fall: 1, // [m/s] of the picture
      trails: false,
      seen: [],
      strobe: asked.has("strobe"),
      projector: asked.has("projector"),
      frameRate: false, // whether the pictures a second are shown
      still: matchMedia("(prefers-reduced-motion: reduce)").matches,
    };
    this.sound = new Sound(this.alignment, (words) => this.tell(words));
    this.chosen = 0; // part
    this.following = null; // key
    this.tour = null; // where a film looks from at each instant
    this.inspected = null; // point
    this.drawn = []; // instants of the pictures of the last second [ms]
    this.isDirty = true;
    this.isLost = false;
    this.isChosen = false; // whether it was told to run or to stand
    this.timeline = new Timeline(element("timeline"), (t) => this.seek(t));
    this.controls = new Controls(this, canvas);
    document.body.classList.toggle("stage", this.stage);
    if (this.stage) addEventListener("click", () => document.documentElement.requestFullscreen?.());
    addEventListener("resize", () => this.resized());
    // With the context, everything on the graphics card is lost.
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => location.reload());
  }

  // --- input ---

  async load(body) {
    const [chunks, bundles] = [new Chunks(), new Bundles()];
    const reader = body.getReader();
    for (;;) {
      const { value, done } = await reader.read();
      if (done) break;
      for (const chunk of chunks.cut(value)) {
        const some = chunk.kind === KIND.bundle ? await bundles.open(chunk) : [chunk];
        for (const one of some) this.take(one);
      }
      this.changed();
    }
    if (!this.story.model) throw new Error("the file ends before its manifest does");
  }

  /** A message of the live piece. A greeting begins like a file, and replaces what came before. */
  takes(bytes) {
    if (!this.live) return;
    if (begins(bytes)) this.chunks = new Chunks();
    for (const chunk of this.chunks?.cut(bytes) ?? []) this.take(chunk);
    if (this.story.isBegun) this.hasBegun();
    this.changed();
  }

  async listen() {
    await this.sound.load("sound.wav").catch((error) => {
      this.tell(`The sound cannot be played (${error.message}); the picture goes on without it.`);
    });
  }

  take(chunk) {
    const before = this.story.model;
    this.story.take(chunk);
    const { model } = this.story;
    if (model !== before || model.version !== this.known) this.begin(model);
  }

  /** A new model, or a table of it. */
  begin(model) {
    const same = this.motion?.story.model === model;
    this.known = model.version;
    this.motion = new Motion(this.story);
    this.presets = presets(model, this.aspect);
    this.camera.scale = this.motion.whole;
    if (!same) this.choices(model);
    if (!this.moved) this.camera.look(this.presets[0]);
    document.title = `${model.title || "ergon"}: view`;
  }

  /** Keeps the choices made for parts by name when the model changes, because points get new numbers. */
  choices(model) {
    const before = new Map(this.look.seen.map((seen, i) => [this.names[i], seen]));
    this.names = model.parts.map((part) => part.name);
    this.look.seen = this.names.map((name) => before.get(name) ?? 1);
    this.chosen = Math.min(this.chosen, Math.max(0, model.parts.length - 1));
    this.following = this.inspected = null;
  }

  lost() {
    this.isLost = true;
    if (!this.stage) this.tell("The connection is lost; what was loaded goes on.");
    this.changed();
  }

  back(another) {
    if (another) return location.reload();
    if (this.isLost && !this.stage) this.tell("");
    this.isLost = false;
    this.changed();
  }

  // --- drawing an instant ---

  get aspect() {
    return this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
  }

  get view() {
    const { rate } = this.clock;
    return { ...this.look, rate, reach: rate, matrix: this.camera.matrix(this.aspect) };
  }

  /** Views fill the picture, whatever its shape. */
  resized() {
    const { model } = this.story;
    if (model) this.presets = presets(model, this.aspect);
    if (model && !this.moved) this.camera.look(this.presets[0]);
    this.changed();
  }

  resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [w, h] = [this.canvas.clientWidth, this.canvas.clientHeight].map((v) => Math.round(v * ratio));
    if (this.canvas.width !== w || this.canvas.height !== h) Object.assign(this.canvas, { width: w, height: h });
  }

  draw() {
    const { story, motion, clock } = this;
    this.resize();
    if (!motion) return;
    if (this.stage && this.isLost) return this.drawing.black();
    this.keepUp();
    const view = this.view;
    this.drawing.instant(story, motion, clock.t, view);
    if (this.stage) return;
    this.labels.place(story, motion, clock.t, view, this.canvas.clientWidth, this.canvas.clientHeight);
    this.timeline.draw(story, clock);
    this.text();
  }

  /** Keeps the key that is followed in the middle of the picture. */
  keepUp() {
    if (this.following === null) return;
    const { model } = this.story;
    const { point } = model.keys[this.following];
    this.camera.target = [model.x[point], model.y[point], model.z[point]];
  }

  text() {
    const { clock, story } = this;
    const { model } = story;
    const mark = model.marks.filter((m) => m.seconds <= clock.t + 1e-9).at(-1);
    const slow = clock.rate === 1 ? "×1" : `×1/${Math.round(1 / clock.rate)}`;
    const part = model.parts[this.chosen];
    const words = [
      model.title || "ergon",
      this.live ? `${shown(clock.t, clock.rate)} live` : `${shown(clock.t, clock.rate)} of ${story.duration.toFixed(1)} s`,
      mark ? `section ${mark.name}` : "",
      `${slow} ${!clock.runs ? "paused" : this.live && !this.live.isNow ? "behind" : "runs"}`,
      part ? `part ${part.name} ${times(this.motion.exaggeration(this.chosen))}` : "",
      `ergons ${this.look.fall.toPrecision(2)} m/s`,
      this.sound.isThere && !this.sound.wanted ? "no sound" : "",
      this.look.frameRate && clock.runs ? `${this.drawn.length} pictures a second` : "",
    ];
    element("bar").textContent = words.filter((w) => w).join("   ");
    const point = element("point");
    point.hidden = this.inspected === null;
    if (this.inspected !== null) point.textContent = describe(story, this.motion, this.inspected, clock.t).join("\n");
    const list = element("levels");
    if (!list.hidden) {
      const rows = levels(story, clock.t).map(({ db }, i) => `${model.speakers[i].name} ${db > -100 ? db.toFixed(0) : "−∞"} dB`);
      list.replaceChildren(...rows.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
    }
  }

  /** Stops the clock and draws exactly one instant [s]. */
  one(t) {
    this.clock.runs = false;
    this.clock.seek(t, this.story.duration, this.story.begins);
    if (this.tour) this.camera.look(this.tour(this.clock.t));
    this.draw();
    this.isDirty = false;
  }

  loop(now) {
    const { clock, story } = this;
    const runs = clock.runs;
    if (story.model) {
      this.tick(now / 1000);
      this.sound.follow(clock);
      if (runs || this.isDirty) {
        this.isDirty = false;
        this.drawn = [...this.drawn.filter((then) => now - then < 1000), now];
        this.draw();
      }
    }
    requestAnimationFrame((next) => this.loop(next));
  }

  /** Advances time to `now` [s] of the page. A live piece is drawn as it is heard only at its own speed. */
  tick(now) {
    const { clock, live, story } = this;
    if (live && clock.rate !== 1) live.isNow = false;
    if (live?.isNow && clock.runs) clock.t = live.follow(clock.t, clock.since(now), performance.now() / 1000, story.end);
    else clock.tick(now, story.duration);
    if (clock.t < story.begins && live) clock.seek(story.begins, story.duration);
  }

  changed() {
    this.isDirty = true;
  }

  tell(text) {
    element("told").textContent = text;
  }

  // --- actions of the user ---

  play(runs) {
    this.isChosen = true;
    if (this.live) this.live.isNow = runs && this.clock.rate === 1;
    else if (runs && this.clock.t >= this.story.duration) this.clock.seek(0, this.story.duration);
    this.clock.runs = runs;
  }

  seek(t) {
    this.clock.seek(t, this.story.duration, this.story.begins);
    if (this.live) {
      // At the end of what was played, follow the live playback again.
      this.live.isNow = t >= this.story.duration;
      if (this.live.isNow) this.play(true);
    }
    this.changed();
  }

  mark(step) {
    const at = this.story.model.marks.map((m) => m.seconds);
    const { t } = this.clock;
    const next = step > 0 ? at.find((s) => s > t + 1e-6) : at.filter((s) => s < t - 1e-6).at(-1);
    if (next !== undefined) this.seek(next);
  }

  preset(i) {
    const look = this.presets[i];
    if (!look) return;
    this.following = null;
    this.moved = true;
    this.camera.look(look);
  }

  /** Starts a tour through presets: stops [t, index] in order. Returns the number of presets if an index does not exist. */
  travel(stops) {
    const looks = stops.map(([t, i]) => [t, this.presets[i]]);
    if (looks.some(([, look]) => !look)) return this.presets.length;
    this.moved = true;
    this.tour = tour(looks);
    return null;
  }

  follow(step) {
    const { keys, parts, partOf } = this.story.model;
    if (!step || !keys.length) {
      this.following = null;
      return;
    }
    this.following = this.following === null ? 0 : (this.following + 1) % keys.length;
    this.moved = true;
    const key = keys[this.following];
    this.chosen = partOf[key.point];
    this.inspected = key.point;
    this.camera.distance = 0.5 * this.motion.whole;
    this.tell(`following ${key.name}${parts[this.chosen] ? `, ${parts[this.chosen].name}` : ""}`);
  }

  choose(step) {
    const { parts } = this.story.model;
    this.chosen = (this.chosen + step + parts.length) % parts.length;
    const part = parts[this.chosen];
    this.tell(`part ${part.name}: ${part.count} points`);
  }

  solo() {
    const { seen } = this.look;
    const alone = seen.every((v, i) => v === (i === this.chosen ? 1 : 0));
    seen.forEach((_, i) => (seen[i] = alone || i === this.chosen ? 1 : 0));
  }

  see(as) {
    const { seen } = this.look;
    seen[this.chosen] = seen[this.chosen] === as ? 1 : as;
  }

  exaggerate(factor) {
    this.motion.lock(this.chosen, this.motion.exaggeration(this.chosen) * factor);
  }

  lock() {
    const now = this.motion.locked[this.chosen];
    this.motion.lock(this.chosen, now === null ? this.motion.exaggeration(this.chosen) : null);
  }

  inspect(step) {
    const part = this.story.model.parts[this.chosen];
    const at = this.inspected === null ? (step > 0 ? -1 : 0) : this.inspected - part.first;
    const next = (((at + step) % part.count) + part.count) % part.count;
    this.showPoint(part.first + next, 40, 90);
  }

  /** The pointer has moved to a pixel. */
  point(x, y) {
    if (!this.motion || this.stage) return;
    this.showPoint(pick(this.story, this.motion, this.view, x, y, this.canvas.clientWidth, this.canvas.clientHeight), x, y);
  }

  showPoint(point, x, y) {
    if (point === null && this.inspected === null) return;
    this.inspected = point;
    const box = element("point");
    box.style.left = `${Math.min(x + 16, innerWidth - 260)}px`;
    box.style.top = `${Math.min(y + 12, innerHeight - 170)}px`;
    this.changed();
  }

  fall(factor) {
    this.look.fall = Math.min(100, Math.max(0.001, this.look.fall * factor));
  }

  align(steps) {
    this.alignment.shift(steps * STEP);
    this.tell(this.alignment.told);
  }

  listLevels() {
    element("levels").hidden = !element("levels").hidden;
  }

  help() {
    const help = element("help");
    help.textContent = this.controls.help();
    help.hidden = !help.hidden;
  }

  close() {
    element("help").hidden = element("levels").hidden = true;
    this.inspected = null;
  }

  /** Pixel of a position [m]; null if it is behind the camera. */
  project(x, y, z) {
    return project(this.view.matrix, x, y, z, this.canvas.width, this.canvas.height);
  }
}

async function main() {
  const canvas = element("picture");
  const gl = context(canvas);
  if (!gl) {
    element("told").textContent = "This browser has no WebGL 2, so nothing can be drawn. A graphics card, or `chromium --enable-unsafe-swiftshader`, gives it one.";
    return;
  }
  const file = await fetch("motion");
  // Requested at every start: another server at the same address may be live instead of serving a file.
  const page = new Page(gl, canvas, file.status === 204);
  window.ergon = {
    page,
    /** Draws exactly one instant. */
    seek: (t) => page.one(t),
    /** Resolves when the whole file is loaded and the first picture is drawn. */
    ready: null,
  };
  page.connection = new Connection({ takes: (bytes) => page.takes(bytes), isLost: () => page.lost(), isBack: (another) => page.back(another) });
  requestAnimationFrame((now) => page.loop(now));
  window.ergon.ready = (page.live ? page.begun : page.load(file.body))
    .catch((error) => {
      page.tell(`The motion cannot be read further: ${error.message}.`);
      if (!page.story.model) throw error;
    })
    .then(async () => {
      page.one(page.live ? page.story.end : Number(asked.get("t") ?? 0) || 0);
      if (asked.has("sound") && !page.live) await page.listen();
      // What was chosen while the sound was loading stays.
      if (!asked.has("t") && !page.look.still && !page.isChosen) page.play(true);
    });
  await window.ergon.ready;
}

main().catch((error) => {
  element("told").textContent = `${error.message}`;
});
