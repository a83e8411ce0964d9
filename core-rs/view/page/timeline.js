// The timeline of the piece: density of ergons, loudness, marks, the loop, and the current instant.

import { after } from "./events.js";

const BINS = 240;

export class Timeline {
  constructor(canvas, seek) {
    this.canvas = canvas;
    this.paper = canvas.getContext("2d");
    this.bins = null;
    const at = (event) => this.begins + (event.offsetX / canvas.clientWidth) * (this.duration - this.begins);
    let held = false;
    canvas.addEventListener("pointerdown", (event) => {
      held = true;
      canvas.setPointerCapture(event.pointerId);
      seek(at(event));
    });
    canvas.addEventListener("pointermove", (event) => held && seek(at(event)));
    canvas.addEventListener("pointerup", () => (held = false));
  }

  /** Counts again if there are new data. */
  count(story) {
    this.begins = story.begins;
    this.duration = story.duration || 1;
    if (this.bins?.story === story && this.bins.ergons === story.ergons.count && this.bins.end === story.end) return;
    const ergons = new Float64Array(BINS);
    const energy = new Float64Array(BINS);
    const instant = (i) => this.begins + (i / BINS) * (this.duration - this.begins);
    const bin = (t) => Math.min(BINS - 1, Math.max(0, Math.floor(((t - this.begins) / (this.duration - this.begins || 1)) * BINS)));
    story.ergons.between(this.begins, this.duration, (e) => ergons[bin(e.t)]++);
    const { times, rows } = story.levels;
    for (let i = 0; i < BINS; i++) {
      const from = after(times, instant(i));
      const to = Math.max(from + 1, after(times, instant(i + 1)));
      for (let k = from; k < to && k < rows.length; k++) energy[i] += rows[k].reduce((sum, v) => sum + v * v, 0) / (to - from);
    }
    this.bins = { story, ergons: story.ergons.count, end: story.end, density: scaled(ergons), energy: scaled(energy) };
  }

  draw(story, clock) {
    const { canvas, paper } = this;
    const ratio = window.devicePixelRatio || 1;
    const [w, h] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(w * ratio)) {
      canvas.width = Math.round(w * ratio);
      canvas.height = Math.round(h * ratio);
    }
    this.count(story);
    const x = (t) => ((t - this.begins) / (this.duration - this.begins || 1)) * w;
    paper.setTransform(ratio, 0, 0, ratio, 0, 0);
    paper.clearRect(0, 0, w, h);
    const bars = (values, colour, low, high) => {
      paper.fillStyle = colour;
      values.forEach((v, i) => paper.fillRect((i * w) / BINS, low - v * high, w / BINS + 0.5, v * high));
    };
    bars(this.bins.energy, "#2c6a55", h, h - 12);
    bars(this.bins.density, "#d9a93a", h, (h - 12) * 0.45);
    if (clock.loop) {
      paper.fillStyle = "#ffffff22";
      paper.fillRect(x(clock.loop[0]), 0, x(clock.loop[1]) - x(clock.loop[0]), h);
    }
    paper.font = "11px system-ui, sans-serif";
    for (const mark of story.model.marks) {
      paper.fillStyle = "#8fa3c0";
      paper.fillRect(x(mark.seconds), 0, 1, h);
      paper.fillText(mark.name, x(mark.seconds) + 3, 10);
    }
    paper.fillStyle = "#ffffff";
    paper.fillRect(x(clock.t) - 1, 0, 2, h);
  }
}

/** Scaled to 0 … 1 by the fourth root, so that small values are visible. */
function scaled(values) {
  const most = values.reduce((a, b) => Math.max(a, b), 0) || 1;
  return values.map((v) => Math.sqrt(Math.sqrt(v / most)));
}
