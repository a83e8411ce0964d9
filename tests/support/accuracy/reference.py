"""The exact motion of a scene: matrix exponentials if it is linear, else Runge-Kutta of order 8.

The method is DOP853 (Dormand and Prince; Hairer, Norsett and Wanner) with the coefficients of
`scipy.integrate.DOP853`, compiled, with no step across a frame or an event. It uses no part of
ergon's engine.

What changes in time is set at each stage (`changing`). The bend of a BRISTLE is an additional
state. A DRY slides one way or holds: a step ends where that changes, found by bisection, so no
step crosses a kink. At most one DRY may rub on a moving mass.
"""

from dataclasses import dataclass

import numba as nb
import numpy as np
from scipy.integrate import DOP853
from scipy.linalg import expm, matrix_balance, schur, solve_sylvester

from accuracy.changing import (
    CHANGE_NUMBERS,
    FOLLOWING_LINK,
    PROXY_NUMBERS,
    set_changing,
    set_proxies,
    spread_forces,
)
from accuracy.equations import ELASTIC, N_NUMBERS, REST, Equations

_TABLEAU = (
    np.vstack([DOP853.A, DOP853.B]),
    np.append(DOP853.C, 1.0),
    np.array(DOP853.E3),
    np.array(DOP853.E5),
)
_STAGES = DOP853.n_stages
TIGHT, LOOSE = 1e-12, 1e-10
_SMALL = 1e-6  # of the largest: what moves less is not asked to be exact by its own size
_FEWEST = 1e-7  # of a frame: the shortest step
_BRISTLE, _DRY = ELASTIC["bristle"], ELASTIC["dry"]
_STILL = 1e-13  # [m/s] of a slide that has stopped
_HALVES = 60  # of a step in which a DRY turns
HEARING = 20e3  # [Hz]: by ear, modes above it are left out and count as no error


@dataclass(frozen=True)
class Reference:
    """Outputs (n_frames, n_out), and the same with a tolerance a hundred times wider.

    `audible`: without the modes above HEARING, if the scene is linear.
    """

    sound: np.ndarray
    rough: np.ndarray
    audible: np.ndarray | None = None


def solve(scene: Equations, n_frames: int) -> Reference:
    """The outputs of a scene at its rate."""
    if scene.is_linear:
        A = _matrix(scene)
        states = _linear(scene, A, n_frames, 1)
        rough = _linear(scene, A, n_frames, 2)
        low = states @ without_high_modes(A, HEARING).T
        return Reference(*(outputs(scene, *_halves(own)) for own in (states, rough, low)))
    return Reference(*(outputs(scene, *integrate(scene, n_frames, tol)) for tol in (TIGHT, LOOSE)))


def outputs(scene: Equations, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Outputs (n_frames, n_out) of positions and velocities (n_frames, n)."""
    ends, kinds, numbers = (np.array(a) for a in (scene.ends, scene.kinds, scene.numbers))
    columns = []
    for kind, i in scene.outputs:
        if kind == "SOX":
            columns.append(x[:, i])
            continue
        assert kinds[i, 0] not in (_BRISTLE, _DRY), "the force of a friction is not heard here"
        a, b = ends[i]
        columns.append(_forces_on_second(*kinds[i], numbers[i], x[:, [a, b]], v[:, [a, b]]))
    return np.stack(columns, axis=1)


def without_high_modes(A: np.ndarray, highest: float) -> np.ndarray:
    """The projection of the states of y' = A·y on the modes up to a frequency [Hz].

    It is along the other modes, so it commutes with A and leaves the motion of the kept modes
    unchanged. By an ordered Schur form (Golub and Van Loan, 2013, 7.6.3).
    """
    balanced, scales = matrix_balance(A, permute=False, separate=True)
    scales = scales[0]
    T, Q, n = schur(
        balanced, output="complex", sort=lambda pole: abs(pole.imag) <= 2 * np.pi * highest
    )
    across = solve_sylvester(T[:n, :n], -T[n:, n:], T[:n, n:]) if n < len(A) else T[:, n:]
    chosen = np.zeros_like(T)
    chosen[:n] = np.hstack([np.eye(n), across])
    return scales[:, None] * (Q @ chosen @ Q.conj().T).real / scales


def _matrix(scene: Equations) -> np.ndarray:
    """A of y' = A·y, y = (x, v, 1)   (2 n + 1, 2 n + 1)."""
    n, mass = len(scene.mass), np.array(scene.mass)
    K, Z = (np.diag([pair[i] for pair in scene.ground]) for i in (0, 1))
    push = np.array(scene.push)
    for (a, b), row in zip(scene.ends, scene.numbers, strict=True):
        e = np.zeros(n)
        e[a], e[b] = 1.0, -1.0
        K, Z = K + row[0] * np.outer(e, e), Z + row[3] * np.outer(e, e)
        push[a] -= row[0] * row[REST]
        push[b] += row[0] * row[REST]
    A = np.zeros((2 * n + 1, 2 * n + 1))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n] = np.hstack([-K, -Z, push[:, None]]) / mass[:, None]
    return A


def _linear(scene: Equations, A: np.ndarray, n_frames: int, parts: int) -> np.ndarray:
    """States (n_frames, 2 n + 1); each frame is computed in `parts` equal parts."""
    n, mass = len(scene.mass), np.array(scene.mass)
    step = np.linalg.matrix_power(expm(A / scene.rate / parts), parts)
    state = np.concatenate([scene.x0, scene.v0, [1.0]])
    strikes = sorted(scene.strikes, key=lambda strike: strike[1])
    out = np.empty((n_frames, len(state)))
    for frame in range(n_frames):
        out[frame] = state
        now, end = frame / scene.rate, (frame + 1) / scene.rate
        if not (strikes and strikes[0][1] < end):
            state = step @ state
            continue
        while strikes and strikes[0][1] < end:
            struck, position, impulse = strikes.pop(0)
            state = expm(A * (position - now)) @ state
            state[n + struck] += impulse / mass[struck]
            now = position
        state = expm(A * (end - now)) @ state
    return out


def _halves(states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (n_frames, n) of states (n_frames, 2 n + 1)."""
    n = states.shape[1] // 2
    return states[:, :n], states[:, n : 2 * n]


def integrate(scene: Equations, n_frames: int, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (n_frames, n) at a relative tolerance."""
    events = [position for _, position, _ in scene.strikes]
    events += [float(t) for path in scene.paths for t in path.spline.x]
    events += [t for row in scene.changes if row[0] < FOLLOWING_LINK for t in row[3:5]]
    frames = np.arange(n_frames) / scene.rate
    events = [
        position
        for position in events
        if position < frames[-1] and np.abs(frames - position).min() > 1e-12
    ]
    when = np.sort(np.concatenate([frames, events]))
    blows = np.zeros((len(when), len(scene.mass)))
    for struck, position, impulse in scene.strikes:
        if position <= frames[-1]:
            blows[np.abs(when - position).argmin(), struck] += impulse / scene.mass[struck]
    # For each gesture and each interval between two instants: the coefficients that are valid at
    # its middle.
    middle = 0.5 * (when[1:] + when[:-1])
    pieces = np.zeros((len(scene.paths), len(middle), 7))
    for i, path in enumerate(scene.paths):
        breaks = path.spline.x
        inside = (middle > breaks[0]) & (middle < breaks[-1])
        which = np.clip(np.searchsorted(breaks, middle) - 1, 0, len(breaks) - 2)
        pieces[i, :, :6] = path.spline.c[:, which].T
        pieces[i, :, 6] = np.where(inside, breaks[which], np.nan)
    leads = np.array([(p.mass, p.image, p.tracked) for p in scene.paths], dtype=np.int64)
    bends = np.array([kind[0] == _BRISTLE for kind in scene.kinds], dtype=bool)
    rubbed = [
        end
        for pair, kind in zip(scene.ends, scene.kinds, strict=True)
        for end in pair
        if kind[0] == _DRY and np.isfinite(scene.mass[end])
    ]
    assert len(set(rubbed)) == len(rubbed), "two DRY rub on one mass"
    assert not (rubbed and scene.paths), "a DRY beside a gesture is not known here"
    changing = (
        np.array(scene.changes, dtype=float).reshape(-1, CHANGE_NUMBERS),
        np.array(scene.proxies.rows, dtype=float).reshape(-1, PROXY_NUMBERS),
        np.array(scene.proxies.members, dtype=np.int64),
    )
    start = np.array([*scene.x0, *scene.v0, *[0.0] * int(bends.sum())])
    set_proxies(start, len(scene.mass), *changing[1:])
    states = _march(
        start,
        when,
        blows,
        1.0 / np.array(scene.mass),
        np.array(scene.ground),
        np.array(scene.push),
        np.array(scene.ends, dtype=np.int64).reshape(-1, 2),
        np.array(scene.kinds, dtype=np.int64).reshape(-1, 2),
        np.array(scene.numbers, dtype=float).reshape(-1, N_NUMBERS),
        np.array(scene.stretched, dtype=float).reshape(-1, 3),
        leads.reshape(-1, 3),
        pieces,
        changing,
        tolerance,
        _TABLEAU,
    )
    assert np.isfinite(states).all(), "the reference went beyond all bounds"
    saved = states[np.searchsorted(when, frames - 1e-13)]
    n = len(scene.mass)
    return saved[:, :n], saved[:, n : 2 * n]


@nb.njit(cache=True)
def _pull(elastic, damping, c, d, w):
    """Force [N] that pulls two ends together, from x_b - x_a and its rate."""
    if elastic == 5:  # a contact: K, exponent, gap, Z, sign, clamp
        depth = -c[4] * d - c[2]
        if depth <= 0.0:
            return 0.0
        push = c[0] * depth ** c[1] - c[3] * c[4] * w
        if c[5] > 0.0 and push < 0.0:
            push = 0.0
        return -c[4] * push
    d -= c[2]
    force = 0.0
    if elastic == 1:
        force = c[0] * d
    elif elastic == 2:
        force = c[0] * d + c[1] * d * d * d
    elif elastic == 3:
        force = c[0] * max(d, 0.0)
    elif elastic == 4:
        force = c[0] * d / c[1] * np.exp(0.5 - 0.5 * (d / c[1]) ** 2)
    elif elastic == 8:
        force = c[0] * np.sign(d) * abs(d) ** c[1]
    if damping == 1:
        force += c[3] * w
    elif damping == 2:
        force += c[3] * w if d > 0.0 else 0.0
    elif damping == 3:
        u = w - c[5]
        force += c[3] * np.sqrt(2.0 * c[4]) * u * np.exp(0.5 - c[4] * u * u)
    elif damping == 4:
        force += c[3] * np.tanh(w / c[4])
    elif damping == 5:  # F, r, v1, v2, u
        u = w - c[7]
        if abs(u) < c[5]:
            force += c[3] * u / c[5]
        else:
            force += c[3] * np.sign(u) * (c[4] + (1.0 - c[4]) * c[6] / (c[6] + abs(u) - c[5]))
    return force


@nb.njit(cache=True)
def _forces_on_second(elastic, damping, c, x, v):
    out = np.empty(len(x))
    for i in range(len(x)):
        out[i] = -_pull(elastic, damping, c, x[i, 1] - x[i, 0], v[i, 1] - v[i, 0])
    return out


@nb.njit(cache=True)
def _level(c, w):
    """Force [N] of a DRY at a rate w of its ends."""
    return c[0] + (c[1] - c[0]) * np.exp(-((w / c[3]) ** 2))


@nb.njit(cache=True)
def _slopes(
    t,
    y,
    dy,
    gesture_masses,
    inverse,
    ground,
    push,
    ends,
    kinds,
    numbers,
    stretched,
    leads,
    pieces,
    changing,
    ways,
    needs,
):
    """dy/dt; running gestures set their masses in y to the path.

    `ways`: the direction in which each DRY slides, 0 if it holds; `needs`: the pull that would
    make it hold.
    """
    n = len(inverse)
    curvature = 2 * n
    changes, proxies, members = changing
    set_changing(t, y, inverse, ground, numbers, changes)
    for g in range(len(leads)):
        p = pieces[g, gesture_masses]
        if np.isnan(p[6]):
            continue
        s = t - p[6]
        x, v = 0.0, 0.0
        for i in range(6):
            v = v * s + x
            x = x * s + p[i]
        y[leads[g, 1]], y[n + leads[g, 1]] = x, v
        if leads[g, 2]:
            y[leads[g, 0]], y[n + leads[g, 0]] = x, v
    set_proxies(y, n, proxies, members)
    for i in range(n):
        dy[i] = y[n + i]
        dy[n + i] = push[i] - ground[i, 0] * y[i] - ground[i, 1] * y[n + i]
    for k in range(len(ends)):
        a, b = ends[k]
        d, w = y[b] - y[a], y[n + b] - y[n + a]
        if kinds[k, 0] == _DRY:
            continue  # it holds against all others
        if kinds[k, 0] == _BRISTLE:  # sigma0, sigma1, sigma2, Fc, Fs, vs
            c = numbers[k]
            level = c[3] + (c[4] - c[3]) * np.exp(-((w / c[5]) ** 2))
            dy[curvature] = w - c[0] * abs(w) * y[curvature] / level
            f = c[0] * y[curvature] + c[1] * dy[curvature] + c[2] * w
            curvature += 1
        else:
            f = _pull(kinds[k, 0], kinds[k, 1], numbers[k], d, w)
        dy[n + a] += f
        dy[n + b] -= f
    for s in range(len(stretched)):
        first, end = int(stretched[s, 0]), int(stretched[s, 1])
        squares = 0.0
        for k in range(first, end):
            squares += (y[ends[k, 1]] - y[ends[k, 0]]) ** 2
        for k in range(first, end):
            a, b = ends[k]
            f = stretched[s, 2] * squares * (y[b] - y[a])
            dy[n + a] += f
            dy[n + b] -= f
    spread_forces(y, dy, n, proxies, members)
    for k in range(len(ends)):
        if kinds[k, 0] != _DRY:
            continue
        a, b = ends[k]
        apart = dy[n + b] * inverse[b] - dy[n + a] * inverse[a]
        needs[k] = apart / (inverse[a] + inverse[b])
        f = ways[k] * _level(numbers[k], y[n + b] - y[n + a]) if ways[k] != 0.0 else needs[k]
        dy[n + a] += f
        dy[n + b] -= f
    for g in range(len(leads)):
        p = pieces[g, gesture_masses]
        if np.isnan(p[6]):
            continue
        s = t - p[6]
        x, v, half = 0.0, 0.0, 0.0
        for i in range(6):
            half = half * s + v
            v = v * s + x
            x = x * s + p[i]
        mass, image = leads[g, 0], leads[g, 1]
        # The force that moves the free copy is also applied to the key.
        needed = 2.0 * half / inverse[image] - dy[n + image]
        dy[n + mass] += needed
        dy[n + image] += needed
        if leads[g, 2]:
            dy[n + mass] = 2.0 * half / inverse[mass]
    for i in range(n):
        dy[n + i] *= inverse[i]


@nb.njit(cache=True)
def _has_turned(y, n, ends, kinds, numbers, ways, needs):
    """Whether a DRY has changed between sliding and holding; `needs` are those of y."""
    for k in range(len(ends)):
        if kinds[k, 0] != _DRY:
            continue
        a, b = ends[k]
        if ways[k] != 0.0:
            margin = ways[k] * (y[n + b] - y[n + a])
        else:
            margin = _level(numbers[k], 0.0) - abs(needs[k])
        if margin < 0.0:
            return True
    return False


@nb.njit(cache=True)
def _turn(y, inverse, ends, kinds, numbers, ways):
    """Remove the remaining rate of the ends of each DRY whose rate has passed zero."""
    n = len(inverse)
    for k in range(len(ends)):
        a, b = ends[k]
        w = y[n + b] - y[n + a]
        if kinds[k, 0] == _DRY and ways[k] * w < 0.0:
            impulse = w / (inverse[a] + inverse[b])
            y[n + a] += impulse * inverse[a]
            y[n + b] -= impulse * inverse[b]


@nb.njit(cache=True)
def _begin(y, n, ends, kinds, numbers, ways, needs):
    """Set the direction of each DRY from here on: that in which it slides, or is pushed."""
    for k in range(len(ends)):
        if kinds[k, 0] != _DRY:
            continue
        a, b = ends[k]
        w = y[n + b] - y[n + a]
        if abs(w) > _STILL:
            ways[k] = np.sign(w)
        elif abs(needs[k]) <= _level(numbers[k], 0.0):
            ways[k] = 0.0
        else:
            ways[k] = np.sign(needs[k])


@nb.njit(cache=True)
def _march(
    start,
    when,
    blows,
    inverse,
    ground,
    push,
    ends,
    kinds,
    numbers,
    stretched,
    leads,
    pieces,
    changing,
    tolerance,
    tableau,
):
    A, C, E3, E5 = tableau
    size = len(start)
    n = len(inverse)
    y = start.copy()
    k = np.zeros((_STAGES + 1, size))
    new, largest = np.empty(size), np.abs(start)
    ways, needs = np.zeros(len(ends)), np.zeros(len(ends))
    has_dry = (kinds[:, 0] == _DRY).any()
    out = np.empty((len(when), size))
    h = when[1] - when[0]
    for index in range(len(when)):
        out[index] = y
        blown = index == 0
        for i in range(n):
            y[n + i] += blows[index, i]
            blown |= blows[index, i] != 0.0
        if index + 1 == len(when):
            break
        t, end = when[index], when[index + 1]
        shortest = _FEWEST * (end - t)
        # For a step in which a DRY turns: its greatest and its least length.
        limit, least, halves = end - t, 0.0, 0
        begins = has_dry and blown
        while t < end:
            if begins:
                _slopes(t, y, k[0], index, inverse, ground, push, ends, kinds, numbers, stretched,
                        leads, pieces, changing, ways, needs)  # fmt: skip
                _begin(y, n, ends, kinds, numbers, ways, needs)
                begins = False
            h = min(h, end - t)
            if halves:  # the last of them takes the shortest step that turns
                h = limit if halves == _HALVES else 0.5 * (least + limit)
            complete = h == end - t
            # The last stage is at the end of the step, given by the weights of order 8.
            for stage in range(_STAGES + 1):
                for i in range(size):
                    total = 0.0
                    for j in range(stage):
                        total += A[stage, j] * k[j, i]
                    new[i] = y[i] + h * total
                _slopes(t + C[stage] * h, new, k[stage], index, inverse, ground, push, ends, kinds,
                        numbers, stretched, leads, pieces, changing, ways, needs)  # fmt: skip
            top_x = max(largest[:n].max(), np.abs(new[:n]).max())
            top_v = max(largest[n : 2 * n].max(), np.abs(new[n : 2 * n]).max())
            top_z = 0.0
            for i in range(2 * n, size):
                top_z = max(top_z, largest[i], abs(new[i]))
            five, three = 0.0, 0.0
            for i in range(size):
                single = max(largest[i], abs(new[i]))
                top = top_x if i < n else top_v if i < 2 * n else top_z
                scale = tolerance * (single + _SMALL * top) + 1e-30
                e5, e3 = 0.0, 0.0
                for j in range(_STAGES + 1):
                    e5 += E5[j] * k[j, i]
                    e3 += E3[j] * k[j, i]
                five += (e5 / scale) ** 2
                three += (e3 / scale) ** 2
            # The error is NaN after a step that diverged: it is repeated with a shorter step.
            error = h * five / np.sqrt((five + 0.01 * three) * size + 1e-300)
            is_taken = error < 1.0 or h <= shortest
            if not is_taken:
                halves = 0  # a DRY whose level changes near its turn: there are shorter steps first
            if is_taken and has_dry:
                turned = _has_turned(new, n, ends, kinds, numbers, ways, needs)
                if halves < _HALVES and (turned or halves):
                    limit, least = (h, least * (halves > 0)) if turned else (limit, h)
                    halves += 1
                    continue
                halves = 0
                if turned:
                    _turn(new, inverse, ends, kinds, numbers, ways)
                    begins = True
            if is_taken:
                t = end if complete else t + h
                for i in range(size):
                    y[i] = new[i]
                    largest[i] = max(largest[i], abs(new[i]))
            factor = 0.1
            if error == 0.0:
                factor = 10.0
            elif np.isfinite(error):
                factor = min(10.0, max(0.1, 0.9 * error ** (-0.125)))
            h = max(h * factor, shortest)
    return out
