"""Models of Synth-A-Modeler played step by step, from the equations of its library alone.

numpy in double precision. It reads correct models only; values are Python's arithmetic, with
sliders at their first value. Outputs are not read: every mass and every link is given by its name.
"""

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

FS = 44_100.0


def played(
    text: str, n_frames: int, ports: Mapping[str, Sequence[float]] = {}
) -> dict[str, np.ndarray]:
    """Positions of masses and forces of links in each sample, (n_frames,) each."""
    names: dict[str, float] = {"fs": FS, "PI": math.pi}
    calls = {"hslider": lambda _, value, *__: value, "nentry": lambda _, value, *__: value}
    rows = []
    waiting = []
    for line in text.splitlines():
        message = re.sub(r"#.*|//.*", "", re.sub(r'"[^"]*"', "0", line)).strip()
        if message.startswith("faustcode:"):
            parts = message.removeprefix("faustcode:").split(";")
            waiting += [part.split("=", 1) for part in parts if part.strip()]
        elif message and not message.startswith(("audioout", "display")):
            rows.append(message)

    def value(expression: str) -> float:
        return float(eval(expression.replace("^", "**"), {"__builtins__": {}}, {**calls, **names}))

    while waiting:  # Faust does not mind their order
        name, expression = waiting.pop(0)
        try:
            names[name.strip()] = value(expression)
        except NameError:
            waiting.append([name, expression])

    masses: dict[str, tuple[str, list[float]]] = {}
    links: list[tuple[str, str, str, str, list[float]]] = []
    for message in rows:
        word, inside, outside = re.fullmatch(r"(\w+)\s*\((.*)\)\s*,(.*);", message).groups()  # type: ignore[union-attr]
        numbers = [value(one) for one in inside.split(",")] if inside.strip() else []
        item, *ends = (one.strip() for one in outside.split(","))
        if ends:
            links.append((word, item, *ends, numbers))
        else:
            masses[item] = (word, numbers)

    index = {name: i for i, name in enumerate(masses)}
    kinds = [kind for kind, _ in masses.values()]
    x = np.zeros(len(index))  # of the sample before
    speed = np.zeros(len(index))
    mobility = np.zeros(len(index))
    for name, (kind, numbers) in masses.items():
        if kind == "mass":
            mobility[index[name]] = 1.0 / (numbers[0] * FS * FS)
    resonances = [
        (index[name], [_resonance(*numbers[i : i + 3]) for i in range(0, len(numbers), 3)])
        for name, (kind, numbers) in masses.items()
        if kind == "resonators"
    ]
    states = {i: np.zeros((len(each), 2)) for i, each in resonances}
    a = np.array([index[one[2]] for one in links], int)
    b = np.array([index[one[3]] for one in links], int)
    k, R, o = (np.array([one[4][i] for one in links], float) for i in range(3))
    is_touch = np.array([one[0] == "touch" for one in links], bool)
    before = np.zeros(len(links))
    places = np.empty((n_frames, len(index)))
    forces = np.empty((n_frames, len(links)))
    for n in range(n_frames):
        for name, samples in ports.items():
            x[index[name]] = samples[n]
        apart = x[a] - x[b] - o
        force = k * apart + R * FS * (apart - before)
        force[is_touch & ~(apart > 0.0)] = 0.0
        before = apart
        complete = np.zeros(len(index))
        np.subtract.at(complete, a, force)
        np.add.at(complete, b, force)
        start = (
            [(one[1][1], one[1][2]) if one[0] == "mass" else (0.0, 0.0) for one in masses.values()]
            if n == 0
            else []
        )
        x = x.copy()
        speed = speed + complete * mobility
        moving = np.array([kind == "mass" for kind in kinds])
        if n == 0:
            speed += np.array([v0 / FS for _, v0 in start])
            x[moving] = (speed + np.array([x0 - v0 / FS for x0, v0 in start]))[moving]
        else:
            x[moving] += speed[moving]
        for name, (kind, numbers) in masses.items():
            if kind == "ground":
                x[index[name]] = numbers[0]
            elif kind == "port" and name not in ports:
                x[index[name]] = 0.0
        for i, each in resonances:
            old, new = states[i], np.empty_like(states[i])
            for row, (c, s, b1, b2) in enumerate(each):
                w, u = old[row]
                new[row] = c * w - s * u + b1 * complete[i], s * w + c * u + b2 * complete[i]
            states[i] = new
            x[i] = new[:, 0].sum()
        places[n] = x
        forces[n] = force
    result = {name: places[:, i] for name, i in index.items()}
    return result | {one[1]: forces[:, i] for i, one in enumerate(links)}


def _resonance(f: float, t60: float, m: float) -> tuple[float, float, float, float]:
    """Rotation and input gains of one resonator in state space, tuned by impulse invariance."""
    decay = math.exp(-1.0 / (t60 / 6.9078) / FS)
    c, s = decay * math.cos(2 * math.pi * f / FS), decay * math.sin(2 * math.pi * f / FS)
    b1 = s / (m * 2 * math.pi * f) / FS
    return c, s, b1, -b1 * c / s
