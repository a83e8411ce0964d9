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

/** Nine views: the whole, the dome from within and above, from the side, then the parts, the largest first. */
export function presets(model) {
  const bench = model.extent();
  const room = model.speakers.reduce((far, s) => Math.max(far, Math.hypot(...s.xyz)), bench.radius);
  const looks = [
    { target: bench.centre, distance: 1.75 * bench.radius, yaw: 0.35, pitch: 0.6 },
    { target: [0, 0.02 * room, 0.3 * room], distance: 0.35 * room, yaw: 0, pitch: -0.35 },
    { target: [0, 0, 0.2 * room], distance: 2.0 * room, yaw: 0, pitch: 1.5 },
    { target: [0, 0, 0.2 * room], distance: 2.1 * room, yaw: 0.5, pitch: 0.3 },
  ];
  const parts = [...model.parts].sort((a, b) => b.count - a.count).slice(0, 5);
  for (const part of parts) {
    const { centre, radius } = model.extent(model.pointsOf(part));
    looks.push({ target: centre, distance: 1.9 * Math.max(radius, 0.1 * bench.radius), yaw: 0.25, pitch: 0.45 });
  }
  return looks;
}
