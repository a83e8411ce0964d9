// Information about one point, shown when the pointer or the keyboard selects it.

import { project } from "./camera.js";
import { flight } from "./flights.js";

const NEAR = 14; // [px]

/** The point drawn nearest to a pixel; null if none is near. */
export function pick(story, motion, look, x, y, width, height) {
  const { model } = story;
  let best = NEAR ** 2;
  let found = null;
  model.parts.forEach((part, i) => {
    if (look.seen[i] === 0) return;
    for (let p = part.first; p < part.first + part.count; p++) {
      if (model.drawn[p] !== p) continue;
      const at = project(look.matrix, ...motion.where(p), width, height);
      if (!at) continue;
      const far = (at[0] - x) ** 2 + (at[1] - y) ** 2;
      if (far < best) {
        best = far;
        found = p;
      }
    }
  });
  return found;
}

/** Description of a point at t: lines of text. */
export function describe(story, motion, point, t) {
  const { model, flights } = story;
  const part = model.parts[model.partOf[point]];
  const lines = [model.nameOf(point)];
  const omega = model.omega[point];
  const sigma = model.sigma[point];
  if (omega > 0) lines.push(`f ${si(omega / (2 * Math.PI), "Hz")}`);
  if (sigma > 0) lines.push(`T60 ${si(Math.log(1000) / sigma, "s")}`);
  if (part.kind === "free") {
    const one = {};
    flight(flights.a[point], flights.b[point], omega, sigma, t - flights.begin[point], one);
    if (one.amplitude > 0) {
      lines.push(`±${si(one.amplitude, "m")}`);
      // The table has no masses: ½ω²A² is the energy per mass.
      lines.push(`energy ${si(0.5 * (omega * one.amplitude) ** 2, "J")} per kg`);
    } else lines.push("at rest");
  } else if (part.kind !== "none") {
    if (model.inSpace(point)) lines.push(`at ${motion.where(point).map((x) => si(x, "m")).join(", ")}`);
    else lines.push(`displacement ${si(motion.z[point], "m")}`);
    if (motion.sweep[point] > 0) lines.push(`±${si(motion.sweep[point], "m")}`);
  } else lines.push("not computed");
  lines.push(...hand(story, point, t), ...lastErgon(story, point, t));
  return lines;
}

/** Position of a key, and the position that its gesture asks for. */
function hand(story, point, t) {
  const number = story.model.keys.findIndex((key) => key.point === point);
  const row = number < 0 ? null : story.hands.at(t)?.get(number);
  if (!row) return [];
  const { name, player } = story.model.keys[number];
  const lines = [`key ${name}${player ? `, ${player}` : ""}: at ${si(row.position, "m")}`];
  if (Number.isFinite(row.asked)) lines.push(`asked to be at ${si(row.asked, "m")}`);
  return lines;
}

function lastErgon(story, point, t) {
  const last = story.ergons.last(t, (e) => e.point === point);
  if (!last) return ["no ergon yet"];
  const speed = Number.isFinite(last.speed) ? ` at ${si(last.speed, "m/s")}` : "";
  const lines = [`last ergon ${si(last.impulse, "N·s")}${speed}, ${last.t.toFixed(3)} s`];
  const source = story.model.source(last.source);
  const place = source?.line ? `${source.file}:${source.line}` : "";
  if (source) lines.push([source.name, place].filter((word) => word).join(", ")); // a part that plays a key has no name
  return lines;
}

const PREFIX = ["p", "n", "µ", "m", "", "k", "M"];

/** A number with its unit, such as 12.3 µm. */
export function si(x, unit) {
  if (!Number.isFinite(x)) return `? ${unit}`;
  if (x === 0) return `0 ${unit}`;
  const step = Math.max(-4, Math.min(2, Math.floor(Math.log10(Math.abs(x)) / 3 + 1e-9)));
  return `${Number((x / 1000 ** step).toPrecision(3))} ${PREFIX[step + 4]}${unit}`;
}
