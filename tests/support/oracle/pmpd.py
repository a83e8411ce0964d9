"""Messages to pmpd and pmpd~ played step by step, from the equations of the objects alone.

Plain Python in double precision, a dict a mass and a dict a link. It reads correct messages of the
objects of one dimension only, one a line.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Thing = dict[str, Any]


def _atoms(text: str) -> list[list[Any]]:
    def atom(word: str) -> Any:
        try:
            return float(word)
        except ValueError:
            return word

    parts = text.replace(";", "\n").replace(",", "\n").splitlines()
    return [[atom(word) for word in part.split()] for part in parts if part.strip()]


def _power(x: float, exponent: float) -> float:
    return math.inf if x == 0.0 and exponent < 0.0 else x**exponent


# --- pmpd~ --------------------------------------------------------------------------------------


def audio(text: str, n_frames: int, inputs: Mapping[int, Sequence[float]] = {}) -> np.ndarray:
    """The outlets of pmpd~ (n_frames, n_outlets)."""
    masses: list[Thing] = []
    links: list[Thing] = []
    springs: list[Thing] = []
    ports: list[tuple[str, int, Thing, float]] = []
    for word, *rest in _atoms(text):
        if word == "mass":
            M, x = [*rest, 0.0, 0.0][:2]
            masses.append({"w": 1.0 / M if M > 0.0 else 0.0, "x": x, "v": 0.0, "f": 0.0})
        elif word == "link":
            a, b, K, D = [*rest, 0.0, 0.0][:4]
            links.append({"a": masses[int(a)], "b": masses[int(b)], "K": K, "D": D})
        elif word == "NLlink":
            a, b, K, D, Pow, L0, low, high = [
                *rest,
                *[0.0, 0.0, 1.0, 0.0, -1e6, 1e6][len(rest) - 2 :],
            ]
            ends = {"a": masses[int(a)], "b": masses[int(b)]}
            springs.append({**ends, "K": K, "D": D, "P": Pow, "L": L0, "low": low, "high": high})
        elif word.rstrip("X") in ("inPos", "inForce", "outPos", "outSpeed"):
            ports.append((word.rstrip("X"), int(rest[0]), masses[int(rest[1])], rest[2]))
        elif word in ("pos", "posX"):
            masses[int(rest[0])]["x"] = rest[1]
        elif word in ("force", "forceX"):
            masses[int(rest[0])]["f"] += rest[1]
        elif word == "setM":
            masses[int(rest[0])]["w"] = 1.0 / rest[1] if rest[1] > 0.0 else 0.0
        elif word in ("setK", "setD"):
            links[int(rest[0])][word[-1]] = rest[1]
        elif word == "setNLK":
            springs[int(rest[0])]["K"] = rest[1]
            if len(rest) > 2:
                springs[int(rest[0])]["P"] = rest[2]
        elif word in ("setNLD", "setNLKPow", "setNLL", "setNLLMin", "setNLLMax"):
            key = {"D": "D", "KPow": "P", "L": "L", "LMin": "low", "LMax": "high"}[word[5:]]
            springs[int(rest[0])][key] = rest[1]
        elif word == "reset":
            masses, links, springs, ports = [], [], [], []
        else:
            assert word in ("pmpd~", "bang", "print"), word
    channels = 1 + max(number for what, number, *_ in ports if what.startswith("out"))
    sound = np.zeros((n_frames, channels))
    for n in range(n_frames):
        for what, number, mass, gain in ports:
            if what == "inPos":
                mass["x"] = gain * inputs[number][n]
            elif what == "inForce":
                mass["f"] += gain * inputs[number][n]
        for item in links:
            a, b = item["a"], item["b"]
            F = item["K"] * (a["x"] - b["x"]) + item["D"] * (a["v"] - b["v"])
            a["f"] -= F
            b["f"] += F
        for item in springs:
            a, b = item["a"], item["b"]
            L = a["x"] - b["x"] - item["L"]
            if item["low"] < L < item["high"]:
                F = item["K"] * _power(abs(L), item["P"])
                F = (-F if L < 0.0 else F) + item["D"] * (a["v"] - b["v"])
                a["f"] -= F
                b["f"] += F
        for item in masses:
            item["v"] += item["f"] * item["w"]
            item["f"] = 0.0
            item["x"] += item["v"]
        for what, number, mass, gain in ports:
            if what.startswith("out"):
                sound[n, number] += gain * mass["x" if what == "outPos" else "v"]
    return sound


# --- pmpd ---------------------------------------------------------------------------------------


def _read(place: float, values: Sequence[float]) -> float:
    sign = 1.0 if place > 0.0 else -1.0
    position = abs(place) * len(values)
    n = int(position)
    if n >= len(values) - 1:
        return sign * values[-1]
    return sign * ((position - n) * values[n + 1] + (1.0 - (position - n)) * values[n])


def bangs(text: str, n_bangs: int) -> np.ndarray:
    """Positions of all masses after each bang (n_bangs, n_masses)."""
    masses: list[Thing] = []
    links: list[Thing] = []
    arrays: dict[str, list[float]] = {}

    def things_of(things: list[Thing], who: Any) -> list[Thing]:
        if isinstance(who, float):
            return [things[int(who)]]
        return [one for one in things if one["of"] == who]

    def join(a: Any, b: Any, more: Thing) -> None:
        for i in things_of(masses, a):
            for j in things_of(masses, b):
                is_second = isinstance(a, str) and a == b and masses.index(i) > masses.index(j)
                if i is not j and not is_second:
                    L = i["x"] - j["x"]
                    links.append({"a": i, "b": j, "L": L, "before": L, **more})

    for word, *rest in _atoms(text):
        if word == "mass":
            name, mobile, M, x = [*rest, *["mass", 1.0, 1.0, 0.0][len(rest) :]]
            w = 1.0 / (M if M > 0.0 else 1.0)
            masses.append(
                {
                    "of": name,
                    "on": mobile >= 1.0,
                    "w": w,
                    "x": x,
                    "v": 0.0,
                    "f": 0.0,
                    "D": 0.0,
                    "n": len(masses),
                }
            )
        elif word == "link":
            name, a, b, K, D, Pow, low, high = [*rest, *[0.0, 0.0, 1.0, -1e6, 1e6][len(rest) - 3 :]]
            single = {"of": name, "K": K, "D": D, "P": Pow, "low": low, "high": high, "tabs": None}
            join(a, b, single)
        elif word == "tabLink":
            name, a, b, k, k_long, d, d_long = rest
            single = {"of": name, "K": 1.0, "D": 1.0, "low": -1e6, "high": 1e6}
            join(a, b, {**single, "tabs": (k, k_long, d, d_long)})
        elif word in ("setPos", "pos", "posX", "setPosX"):
            for item in things_of(masses, rest[0]):
                item |= {"x": rest[1], "v": 0.0, "f": 0.0}
        elif word in ("addPos", "force", "setForce", "setSpeed", "setDEnv"):
            key, is_sum = {
                "addPos": ("x", True),
                "force": ("f", True),
                "setForce": ("f", False),
                "setSpeed": ("v", False),
                "setDEnv": ("D", False),
            }[word]
            for item in things_of(masses, rest[0]):
                item[key] = rest[1] + is_sum * item[key]
        elif word == "setM":
            for item in things_of(masses, rest[0]):
                item["w"] = 1.0 / rest[1] if rest[1] > 0.0 else item["w"]
        elif word in ("setFixed", "setMobile"):
            for item in things_of(masses, rest[0]):
                item["on"] = word == "setMobile"
        elif word in ("setK", "setD", "setPow", "setL", "addL"):
            key = {"setPow": "P", "addL": "L"}.get(word, word[3:])
            for item in things_of(links, rest[0]):
                item[key] = rest[1] + (item["L"] if word == "addL" else 0.0)
        elif word == "reset":
            masses, links = [], []
        elif rest and rest[0] == "resize":
            arrays[word] = [*arrays.get(word, []), *[0.0] * int(rest[1])][: int(rest[1])]
        elif rest and isinstance(rest[0], float) and word not in ("pmpd",):
            first, values, single_array = int(rest[0]), rest[1:], arrays.setdefault(word, [])
            single_array += [0.0] * (first + len(values) - len(single_array))
            single_array[first : first + len(values)] = values
        else:
            assert word in ("pmpd", "bang", "print", "infosL") or word.startswith("mass"), word
    moved = np.zeros((n_bangs, len(masses)))
    for n in range(n_bangs):
        for item in masses:
            if item["on"]:
                item["v"] += item["f"] * item["w"]
                item["x"] += item["v"]
                item["f"] = -item["D"] * item["v"]
        for item in links:
            a, b = item["a"], item["b"]
            L, before = a["x"] - b["x"], item["before"]
            if item["low"] <= L < item["high"] and L != 0.0:
                if item["tabs"]:
                    k, k_long, d, d_long = item["tabs"]
                    F = item["D"] * _read((L - before) / d_long, arrays[d])
                    F += item["K"] * _read(L / k_long, arrays[k])
                else:
                    F = item["D"] * (L - before)
                    e = L - item["L"]
                    F += item["K"] * (_power(e, item["P"]) if e >= 0.0 else -_power(-e, item["P"]))
                a["f"] -= F
                b["f"] += F
            item["before"] = L
        moved[n] = [item["x"] for item in masses]
    return moved
