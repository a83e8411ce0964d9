// Position and direction of the camera: a target, a distance and two angles; z is up.

/** Focal length in half heights of the picture. */
export const FOCAL = 1.6;
const UP = 1.5; // [rad] as far as one can look down or up

export class Camera {
  constructor() {
    this.target = [0, 0, 0];
    this.distance = 4;
    this.yaw = 0; // [rad] 0: from the front (−y), looking at +y
    this.pitch = 0.5; // [rad] above the horizon
    this.scale = 1; // [m] size of the scene; steps are shares of it
  }

  /** Position of the camera [m]. */
  eye() {
    const [x, y, z] = this.forward();
    return this.target.map((v, i) => v - this.distance * [x, y, z][i]);
  }

  forward() {
    const c = Math.cos(this.pitch);
    return [c * Math.sin(this.yaw), c * Math.cos(this.yaw), -Math.sin(this.pitch)];
  }

  right() {
    return [Math.cos(this.yaw), -Math.sin(this.yaw), 0];
  }

  up() {
    const [a, b, c] = this.right();
    const [x, y, z] = this.forward();
    return [b * z - c * y, c * x - a * z, a * y - b * x];
  }

  look({ target, distance, yaw, pitch }) {
    Object.assign(this, { target: [...target], distance, yaw, pitch });
  }

  orbit(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-UP, Math.min(UP, this.pitch + pitch));
  }

  /** Moves sideways and upwards, by shares of the distance. */
  pan(right, up) {
    const [r, u] = [this.right(), this.up()];
    this.target = this.target.map((v, i) => v + this.distance * (right * r[i] + up * u[i]));
  }

  /** Moves nearer by a share of the distance; once it is near, the target moves along, so that the camera dives into the scene. */
  dive(share) {
    const least = 0.02 * this.scale;
    const step = this.distance * share;
    if (this.distance - step >= least) {
      this.distance -= step;
    } else {
      const forward = this.forward();
      this.target = this.target.map((v, i) => v + step * forward[i]);
    }
  }

  /** Matrix from metres to the picture, column by column; `aspect`: width over height. */
  matrix(aspect) {
    const rows = [this.right(), this.up(), this.forward().map((v) => -v)];
    const eye = this.eye();
    const shift = rows.map((row) => -row.reduce((sum, v, i) => sum + v * eye[i], 0));
    const near = 0.005 * this.scale;
    const far = 100 * this.scale + 10 * this.distance;
    const k = (far + near) / (near - far);
    const m = new Float32Array(16);
    for (let i = 0; i < 4; i++) {
      const at = (row) => (i < 3 ? rows[row][i] : shift[row]);
      m[4 * i] = (FOCAL / aspect) * at(0);
      m[4 * i + 1] = FOCAL * at(1);
      m[4 * i + 2] = k * at(2) + (i === 3 ? (2 * far * near) / (near - far) : 0);
      m[4 * i + 3] = -at(2);
    }
    return m;
  }
}

/** Pixel of a position [m] in a picture of width by height [px], from its upper left; null if it is behind the camera. */
export function project(m, x, y, z, width, height) {
  const w = m[3] * x + m[7] * y + m[11] * z + m[15];
  if (w <= 0) return null;
  const u = (m[0] * x + m[4] * y + m[8] * z + m[12]) / w;
  const v = (m[1] * x + m[5] * y + m[9] * z + m[13]) / w;
  return [((u + 1) / 2) * width, ((1 - v) / 2) * height, w];
}

// Shares of half the picture within which a view puts what it shows: the bar is above it, the timeline and labels below.
const SIDES = 0.86;
const ABOVE = 0.84;
const BELOW = 0.68;
const HEIGHTS = [0.6, 0.5, 0.4, 0.3]; // [rad] above the horizon
const FITTED = 5000; // points by which a view is fitted

/**
 * The look in a direction in which points [[x, y, z], …] fill a picture of an aspect (width over height) and none is
 * outside it.
 */
export function fitting(points, yaw, pitch, aspect, least) {
  const camera = new Camera();
  Object.assign(camera, { yaw, pitch });
  const axes = [camera.right(), camera.up(), camera.forward()];
  const kx = (SIDES * aspect) / FOCAL;
  const [above, below] = [ABOVE / FOCAL, BELOW / FOCAL];
  // With the eye at depth e and sideways at s, a point (a, b, c) is within the left and right edges if
  // |a − s| ≤ kx (c − e), so that e is at most −(right + left) / 2kx; likewise for the upper and lower edge.
  const edges = { right: -Infinity, left: -Infinity, top: -Infinity, bottom: -Infinity };
  let [near, far] = [Infinity, -Infinity];
  for (const point of points) {
    const [a, b, c] = axes.map((axis) => axis.reduce((sum, v, i) => sum + v * point[i], 0));
    edges.right = Math.max(edges.right, a - kx * c);
    edges.left = Math.max(edges.left, -a - kx * c);
    edges.top = Math.max(edges.top, b - above * c);
    edges.bottom = Math.max(edges.bottom, -b - below * c);
    near = Math.min(near, c);
    far = Math.max(far, c);
  }
  if (near > far) return { target: [0, 0, 0], distance: 1.75, yaw, pitch };
  const eye = Math.min(-(edges.right + edges.left) / (2 * kx), -(edges.top + edges.bottom) / (above + below), near - least);
  const across = (edges.right - edges.left) / 2;
  const up = (edges.top + above * eye - (edges.bottom + below * eye)) / 2;
  const depth = (near + far) / 2;
  const target = [0, 1, 2].map((i) => across * axes[0][i] + up * axes[1][i] + depth * axes[2][i]);
  return { target, distance: depth - eye, yaw, pitch };
}

/** The share of a picture of an aspect that the rectangle around points takes. */
function filled(points, look, aspect) {
  const matrix = Object.assign(new Camera(), look).matrix(aspect);
  const [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
  for (const point of points) {
    const seen = project(matrix, ...point, 1, 1);
    for (const i of [0, 1]) {
      low[i] = Math.min(low[i], seen?.[i] ?? 0);
      high[i] = Math.max(high[i], seen?.[i] ?? 0);
    }
  }
  return (high[0] - low[0]) * (high[1] - low[1]);
}

/** The look from that height, of some, from which points fill the most of a picture. */
function fullest(points, yaw, aspect, least) {
  const looks = HEIGHTS.map((pitch) => fitting(points, yaw, pitch, aspect, least));
  const shares = looks.map((look) => filled(points, look, aspect));
  return looks[shares.indexOf(Math.max(...shares))];
}

/** Nine views: the whole, the dome from within and above, from the side, then the parts, the largest first. */
export function presets(model, aspect) {
  const bench = model.extent();
  const least = 0.1 * bench.radius;
  const room = model.speakers.reduce((far, s) => Math.max(far, Math.hypot(...s.xyz)), bench.radius);
  const place = (p) => [model.x[p], model.y[p], model.z[p]];
  const step = Math.max(1, Math.ceil(model.n / FITTED));
  const all = Array.from({ length: Math.ceil(model.n / step) }, (_, i) => place(i * step));
  const dome = [...all, ...model.speakers.map((s) => s.xyz)];
  const looks = [
    fullest(all, 0.35, aspect, least),
    // From behind the listener, so that the loudspeakers in front and overhead are seen.
    { target: [0, 0, 0.26 * room], distance: 1.12 * room, yaw: 0, pitch: -0.09 },
    fitting(dome, 0, 1.5, aspect, least),
    fitting(dome, 0.5, 0.3, aspect, least),
  ];
  const parts = [...model.parts].sort((a, b) => b.count - a.count).slice(0, 5);
  for (const part of parts) looks.push(fitting(Array.from(model.pointsOf(part), place), 0.25, 0.45, aspect, least));
  return looks;
}
