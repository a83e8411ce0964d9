"""From a Scene to samples: discretisation, first step, strikes, gestures, then the loop."""

import math
from dataclasses import dataclass

import numpy as np

from oracle import derivative, kernel
from oracle.gesture import ergons, path
from oracle.scene import Link, Point, Scene


def discrete(point: Point, T: float) -> tuple[float, float, float]:
    """(κ, ζ, T²/m) of one MAT at step T [s]; a CEL pole-exactly unless its numbers are CA's."""
    if math.isinf(point.M):
        return 0.0, 0.0, 0.0
    g = 1.0 / point.M if point.ca else T * T / point.M
    if not point.cel:
        return 0.0, 0.0, g
    if point.ca and point.tuned is None:
        return point.K / point.M, point.Z / point.M, g
    sigma, omega2 = decay(point)
    single_r = -math.expm1(-sigma * T)
    r = 1.0 - single_r
    half = 0.5 * T * math.sqrt(abs(omega2))
    turn = math.sin(half) if omega2 >= 0.0 else math.sinh(half)
    kappa = single_r**2 + math.copysign(4.0 * r * turn**2, omega2)
    return kappa, -math.expm1(-2.0 * sigma * T), g


def decay(point: Point) -> tuple[float, float]:
    """(σ [1/s], ω_d² [1/s²]) of a CEL; ω_d² < 0 when overdamped."""
    if point.tuned is not None:
        f, t60 = point.tuned
        sigma = 3.0 * math.log(10.0) / t60 if t60 is not None else 0.0
        return sigma, (2.0 * math.pi * f) ** 2
    sigma = point.Z / (2.0 * point.M)
    return sigma, point.K / point.M - sigma**2


def backward(point: Point, T: float) -> float:
    """x(0) - x(-T) [m] of the CEL alone, by its exact flow."""
    sigma, omega2 = decay(point)
    s = sigma * T
    u, v = point.X0 - point.rest, point.V0
    if omega2 > 0.0:
        omega = math.sqrt(omega2)
        single_c = -math.expm1(s) + math.exp(s) * 2.0 * math.sin(0.5 * omega * T) ** 2
        sine = math.exp(s) * math.sin(omega * T) / omega
    elif omega2 < 0.0:
        omega = math.sqrt(-omega2)
        single_c = -math.expm1(s) - math.exp(s) * 2.0 * math.sinh(0.5 * omega * T) ** 2
        sine = math.exp(s) * math.sinh(omega * T) / omega
    else:
        single_c, sine = -math.expm1(s), math.exp(s) * T
    return u * single_c + sine * (v + sigma * u)


def row_of(link: Link, scene: Scene, T: float) -> tuple[int, list[float]]:
    """Kind and parameters of a link in the kernel's units (forces N, steps in m)."""
    row = [0.0] * 11
    per_v = 1.0 if link.ca else 1.0 / T
    K, Z = link.K, link.Z * per_v
    kind = {
        "ref": kernel.LINEAR,
        "lnl": kernel.LNL,
        "exact": kernel.EXACT,
        "dry": kernel.DRY,
    }.get(link.kind, kernel.BUT)
    if link.kind == "magic":
        beta = sum(discrete(scene.mats[i], T)[2] for i in (link.a, link.b))
        r = link.restitution ** (1.0 / link.steps)
        K = (1.0 + r * r - 2.0 * r * math.cos(math.pi / link.steps)) / beta
        Z = (1.0 - r * r) / beta
    row[kernel.K], row[kernel.Z], row[kernel.OFFSET] = K, Z, link.offset
    row[kernel.EXPONENT] = link.exponent
    row[kernel.SIGN] = 1.0 if link.side == "below" else -1.0
    row[kernel.CLAMP], row[kernel.PER_V] = float(link.clamp), per_v
    if link.kind == "dry":
        row[kernel.C0], row[kernel.C1] = link.static or link.K, link.speed
    if link.law is not None:
        row[kernel.NUMBER] = link.law.number
        row[kernel.C0 : kernel.C2 + 1] = link.law.values()
    return kind, row


@dataclass
class Result:
    """Outputs (n_frames, n_out), the positions after the last frame and the last steps (n_mat,)."""

    out: np.ndarray
    x: np.ndarray
    d: np.ndarray


def simulate(scene: Scene, rate: float, n_frames: int, *, link_start: bool = True) -> Result:
    """Run the scene. `link_start=False` leaves link forces out of the first step of a CEL."""
    T = 1.0 / rate
    points = [discrete(p, T) for p in scene.mats]
    ground = [
        p.K if not p.ca or p.tuned is None else k * p.M
        for p, (k, _, _) in zip(scene.mats, points, strict=True)
    ]
    mats = np.array(
        [(k, z, g, p.rest, gr) for p, (k, z, g), gr in zip(scene.mats, points, ground, strict=True)]
    )
    links = [row_of(link, scene, T) for link in scene.lias]
    kinds = np.array([kind for kind, _ in links], dtype=np.int64)
    rows = np.array([row for _, row in links]).reshape(len(links), 11)
    ends = np.array([(ln.a, ln.b) for ln in scene.lias], dtype=np.int64).reshape(len(links), 2)

    when = np.arange(n_frames + 1) * T
    forced = sorted(
        {
            *scene.keys,
            *(m for m, *_ in scene.strikes),
            *(m for m, kind, _ in scene.drives if kind == "force"),
        }
    )
    forces = np.zeros((n_frames, len(forced)))
    column = {m: i for i, m in enumerate(forced)}
    path_at = [m for m, kind, _ in scene.drives if kind == "position"]
    paths = [curve(when) for _, kind, curve in scene.drives if kind == "position"]
    for mat, kind, curve in scene.drives:
        if kind == "force":
            forces[:, column[mat]] += curve(when[:-1])

    x = np.array([p.X0 for p in scene.mats])
    for mat, values in zip(path_at, paths, strict=True):
        x[mat] = values[0]
        mats[mat, 2] = 0.0
    d = first_step(scene, x, kinds, ends, rows, T, forces, forced, path_at, link_start)

    hits = strike(scene, rate, mats, forces, column)
    for gesture in scene.gestures:
        mat = scene.keys[gesture.key]
        asked = path(gesture.t, gesture.x, gesture.curve, when)
        if gesture.touch == "tracked":
            path_at.append(mat)
            paths.append(asked)
        else:
            k, z, g = points[mat]
            point = scene.mats[mat]
            free = d_alone(point, T)
            forces[:, column[mat]] += ergons(asked, k, z, g, point.X0, free, point.rest)
    taps = [(o, what, i) for o, out in enumerate(scene.outs) for what, i, _ in out]
    weights = [w for out in scene.outs for _, _, w in out]
    out = kernel.run(
        x,
        d,
        mats,
        kinds,
        ends,
        rows,
        np.array(taps, dtype=np.int64).reshape(len(taps), 3),
        np.array(weights, dtype=float),
        len(scene.outs),
        np.array(forced, dtype=np.int64),
        forces,
        np.array(path_at, dtype=np.int64),
        np.array(paths).reshape(len(path_at), n_frames + 1).T.copy(),
        hits,
    )
    for column, order in enumerate(scene.orders):
        out[:, column] = derivative.differentiated(out[:, column], order, rate)
    return Result(out, x, d)


def d_alone(point: Point, T: float) -> float:
    """x[0] - x[-1] of a MAT without links."""
    if point.ca or not point.cel:
        return T * point.V0
    return backward(point, T)


def first_step(scene, x, kinds, ends, rows, T, forces, forced, path_at, link_start):
    """d[0] = x[0] - x[-1] of every MAT (n_mat,)."""
    velocity = np.array([T * p.V0 for p in scene.mats])
    velocity[path_at] = 0.0
    force = np.zeros(len(x))
    for j, (a, b) in enumerate(ends):
        if kinds[j] == kernel.DRY:
            continue
        kind = kernel.BUT if kinds[j] == kernel.EXACT else kinds[j]
        f = kernel.pull(kind, rows[j], velocity[a], x[a], velocity[b], x[b])
        force[a] += f
        force[b] -= f
    for mat, kind, curve in scene.drives:
        if kind == "force":
            force[mat] += curve(np.zeros(1))[0]
    for row, kind, (a, b) in zip(rows, kinds, ends, strict=True):
        if kind == kernel.DRY:
            f = rub(scene, row, int(a), int(b), force)
            force[a] += f
            force[b] -= f
    d = np.zeros(len(x))
    for i, p in enumerate(scene.mats):
        if math.isinf(p.M) or i in path_at:
            continue
        d[i] = d_alone(p, T)
        if not p.ca and (link_start or not p.cel):
            d[i] -= 0.5 * T * T / p.M * force[i]
    return d


def rub(scene, row, a, b, force):
    """Dry friction just before t = 0. A MAT that is set off is taken to have come from the other
    side and turned.
    """
    ends = [(scene.mats[b], force[b], 1.0), (scene.mats[a], force[a], -1.0)]
    v = sum(sign * p.V0 for p, _, sign in ends)
    static = row[kernel.C0] - row[kernel.K]
    level = row[kernel.K] + static * math.exp(-((v / row[kernel.C1]) ** 2))
    if v:
        return math.copysign(level, v)
    ties = [f - (p.K * (p.X0 - p.rest) + p.Z * p.V0 if p.cel else 0.0) for p, f, _ in ends]
    needed = sum(sign * tie / p.M for (p, _, sign), tie in zip(ends, ties, strict=True))
    needed /= sum(1.0 / p.M for p, _, _ in ends)
    return needed if abs(needed) <= level else -math.copysign(level, needed)


def strike(scene, rate, mats, forces, column):
    """Put impulses into `forces`; return the ergons with mass and speed (n_hit, 4)."""
    T = 1.0 / rate
    linked = {i for link in scene.lias for i in (link.a, link.b)}
    key_parts = {scene.mats[m].part for m in scene.keys}
    hits = []
    for mat, position, impulse, mass, speed in scene.strikes:
        point = scene.mats[mat]
        complete = point.ca or point.part in key_parts
        n = math.floor(position * rate + 0.5) if complete else math.floor(position * rate)
        late = 0.0 if complete else position * rate - n
        if not math.isnan(mass):
            struck = point.M * T * T if point.ca else point.M
            hits.append((float(n), float(mat), mass / struck, speed * T))
            continue
        if point.cel and mat not in linked and not complete:
            sigma, omega2 = decay(point)
            omega, r = math.sqrt(omega2), math.exp(-sigma * T)
            gain = impulse / (T * T * omega)
            now = gain * r ** (1.0 - late) * math.sin((1.0 - late) * omega * T)
            then = gain * r ** (2.0 - late) * math.sin(late * omega * T)
        else:
            now, then = (1.0 - late) * impulse / T, late * impulse / T
        for frame, force in ((n, now), (n + 1, then)):
            if frame < len(forces):
                forces[frame, column[mat]] += force
    return np.array(sorted(hits)).reshape(len(hits), 4)
