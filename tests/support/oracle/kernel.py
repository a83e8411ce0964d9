"""The loop: links, then masses, one sample after the other, in the order they were written."""

import math

import numpy as np

from oracle.compiled import compiled
from oracle.laws import law

LINEAR, BUT, EXACT, LNL, DRY = range(5)
# Columns of a link's row.
K, Z, OFFSET, EXPONENT, SIGN, CLAMP, NUMBER, PER_V, C0, C1, C2 = range(11)
POSITION, FORCE, GROUND = range(3)


GAUSS_X, GAUSS_W = np.polynomial.legendre.leggauss(8)


@compiled
def quotient(u, w, stiffness, exponent):
    """(V(u) - V(w))/(u - w) for V = K·p₊^(α+1)/(α+1)."""
    n = exponent + 1.0
    if min(u, w) > 0.0 and abs(u - w) < 0.1 * max(u, w):
        # the difference loses digits here: the mean of the force between w and u does not
        q = 0.0
        for i in range(8):
            q += 0.5 * GAUSS_W[i] * (0.5 * (u + w) + 0.5 * (u - w) * GAUSS_X[i]) ** exponent
        return stiffness * q
    vu = u**n if u > 0.0 else 0.0
    vw = w**n if w > 0.0 else 0.0
    return stiffness * (vu - vw) / (n * (u - w))


@compiled
def exact_contact(p, w, beta, stiffness, exponent):
    """Penetration u at n+1 that solves u = p - β·(V(u)-V(w))/(u-w), V = K·p₊^(α+1)/(α+1).

    p: u without contact; w: penetration at n-1 (Chatziioannou and van Walstijn 2015). By
    bisection, which needs no formula: V is convex, so the residual rises with u.
    """
    if p <= 0.0 and w <= 0.0:
        return p
    high = p  # the contact only pushes
    low = p - beta * stiffness * max(p, w, 0.0) ** exponent
    for _ in range(2000):
        u = 0.5 * (low + high)
        if u <= low or u >= high:
            break
        if u - p + beta * quotient(u, w, stiffness, exponent) > 0.0:
            high = u
        else:
            low = u
    return 0.5 * (low + high)


@compiled
def closed_contact(p, w, beta, stiffness):
    """The same for exponent 1, in closed form."""
    a = 0.5 * beta * stiffness
    if w >= 0.0:
        u = (p - a * w) / (1.0 + a)
        if u < 0.0:
            u = 0.5 * ((p + w) - math.sqrt((p - w) ** 2 + 4.0 * a * w * w))
        return u
    if p <= 0.0:
        return p
    return ((p + w) + math.sqrt((p + w) ** 2 - 4.0 * (1.0 + a) * p * w)) / (2.0 * (1.0 + a))


@compiled
def turned(v, gain, bound):
    """The step after `v` that gains `gain`, reduced by dry friction by at most `bound`."""
    if v == 0.0 and abs(gain) <= bound:
        return 0.0
    method = 1.0 if (v > 0.0 or (v == 0.0 and gain > 0.0)) else -1.0
    to = method * (v + gain) - bound
    if to >= 0.0:
        return method * to
    before, after = method * gain - bound, method * gain + bound
    return 0.0 if after >= 0.0 else method * to * after / before


@compiled
def friction(row, v, free, beta):
    """Force [N] of dry friction on its first point, for the last step v and the step `free` [m]
    without friction.
    """
    level, static, speed = row[K], row[C0], row[C1]
    slow = np.exp(-((v * row[PER_V] / speed) ** 2))
    to = turned(v, free - v, beta * (level + (static - level) * slow))
    if static != level:
        slow = np.exp(-((0.5 * (v + to) * row[PER_V] / speed) ** 2))
        to = turned(v, free - v, beta * (level + (static - level) * slow))
        if v * to < 0.0 and abs(free - v) <= beta * static:
            to = 0.0
    return (free - to) / beta


@compiled
def pull(kind, row, da, xa, db, xb):
    """Force [N] of an explicit link on its first point, from positions x and last steps d."""
    if kind == LINEAR:
        return row[K] * (xb - xa - row[OFFSET]) + row[Z] * (db - da)
    if kind == LNL:
        return law(int(row[NUMBER]), row[C0:], xb - xa - row[OFFSET], row[PER_V] * (db - da))
    p = row[SIGN] * (xa - xb) - row[OFFSET]
    if p <= 0.0:
        return 0.0
    size = row[K] * p ** row[EXPONENT] + row[Z] * row[SIGN] * (da - db)
    if row[CLAMP] != 0.0 and size < 0.0:
        size = 0.0
    return -row[SIGN] * size


@compiled
def run(
    x, d, mats, kinds, ends, rows, taps, weights, n_out, force_at, forces, path_at, paths, hits
):
    """Step len(forces) frames from positions x and last steps d, both (n_mat,) and changed.

    mats (n_mat, 5): κ, ζ, T²/m (0: fixed), rest, K of the ground. kinds (n_lia,), ends (n_lia, 2),
    rows (n_lia, 11). taps (n_tap, 3): output, what, index; weights (n_tap,).
    forces (n_frames, n_force) [N] on force_at; paths (n_frames + 1, n_path) [m] of path_at, NaN
    where the MAT is free. hits (n_hit, 4): frame, MAT, mass of the ergon over the MAT's, its speed
    times T [m], by frame.
    Returns the outputs (n_frames, n_out).
    """
    n_frames = forces.shape[0]
    out = np.zeros((n_frames, n_out))
    f = np.zeros(len(x))
    g = np.zeros(len(x))  # T²/m, 0 where the position is given
    y = np.zeros(len(x))  # step to come, x[n+1] - x[n]
    on_a = np.zeros(len(kinds))
    hit = 0
    for n in range(n_frames):
        f[:] = 0.0
        for i in range(len(force_at)):
            f[force_at[i]] += forces[n, i]
        for j in range(len(kinds)):
            if kinds[j] != EXACT and kinds[j] != DRY:
                a, b = ends[j]
                on_a[j] = pull(kinds[j], rows[j], d[a], x[a], d[b], x[b])
                f[a] += on_a[j]
                f[b] -= on_a[j]
        for i in range(len(x)):
            free = mats[i, 2] > 0.0
            y[i] = (
                d[i] - mats[i, 1] * d[i] - mats[i, 0] * (x[i] - mats[i, 3]) + mats[i, 2] * f[i]
                if free
                else 0.0
            )
        g[:] = mats[:, 2]
        for i in range(len(path_at)):
            if not math.isnan(paths[n + 1, i]):
                y[path_at[i]] = paths[n + 1, i] - x[path_at[i]]
                g[path_at[i]] = 0.0
        for j in range(len(kinds)):
            if kinds[j] == EXACT:
                row = rows[j]
                a, b = ends[j]
                w = row[SIGN] * ((x[a] - d[a]) - (x[b] - d[b])) - row[OFFSET]
                p = row[SIGN] * ((x[a] + y[a]) - (x[b] + y[b])) - row[OFFSET]
                beta = g[a] + g[b]
                if row[EXPONENT] == 1.0:
                    u = closed_contact(p, w, beta, row[K])
                else:
                    u = exact_contact(p, w, beta, row[K], row[EXPONENT])
                on_a[j] = -row[SIGN] * (p - u) / beta
                y[a] += g[a] * on_a[j]
                y[b] -= g[b] * on_a[j]
        for j in range(len(kinds)):
            if kinds[j] == DRY:
                a, b = ends[j]
                on_a[j] = friction(rows[j], d[b] - d[a], y[b] - y[a], g[a] + g[b])
                y[a] += g[a] * on_a[j]
                y[b] -= g[b] * on_a[j]
        while hit < len(hits) and hits[hit, 0] == n:
            # p = 2mM/(m+M)·(v - V) with the centred velocity V, so that work equals loss
            i = int(hits[hit, 1])
            y[i] += 2.0 * hits[hit, 2] / (1.0 + hits[hit, 2]) * (hits[hit, 3] - 0.5 * (y[i] + d[i]))
            hit += 1
        for t in range(len(weights)):
            o, what, i = taps[t]
            if what == POSITION:
                out[n, o] += weights[t] * x[i]
            elif what == FORCE:
                out[n, o] -= weights[t] * on_a[i]
            else:
                out[n, o] += weights[t] * mats[i, 4] * (x[i] - mats[i, 3])
        for i in range(len(x)):
            d[i] = y[i]
            x[i] += y[i]
    return out
