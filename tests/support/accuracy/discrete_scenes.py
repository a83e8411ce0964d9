"""Random scenes under `units: ca`: networks whose numbers were chosen at 44,100 Hz."""

from collections.abc import Callable

import numpy as np

from accuracy.dice import Dice, Modules, add_strike, listen_to

RATE = 44_100  # [Hz] at which the numbers are those of the network


def discrete_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A network of one of seven kinds by its numbers."""
    score["rates"] = {"audio": f"{RATE}Hz"}
    score["instruments"]["s"] |= {"units": "ca", "at": f"{RATE}Hz"}
    kinds: tuple[Callable[[Dice, Modules, Modules, Modules], None], ...]
    kinds = (_row, _damped_body, _hammer, _chain, _bow, _slow_row, _key)
    dice.choose(*kinds)(dice, score, modules, out)


def _stiffness(M: float, f: float) -> float:
    """K of a mass M that is to swing at about f [Hz]."""
    return M * (2.0 * np.pi * f / RATE) ** 2


def _knock(dice: Dice, score: Modules, to: str, M: float, speed: float) -> None:
    """Strike a mass M so that it leaves at a speed [m/s]: the force acts for one frame."""
    add_strike(dice, score, to, M * speed / RATE**2)


def _string(dice: Dice) -> tuple[Modules, int, float]:
    """A string by K and Z of its links, its number of masses, and the mass of each."""
    n = dice.integer(8, 60)
    m = dice.by_ratio(0.1, 10.0)
    # The highest mode is at about twice the frequency of one link.
    K = _stiffness(m, dice.by_ratio(1000.0, 5000.0))
    Z = K * dice.choose(0.0, dice.by_ratio(1e-3, 0.2))
    return {"STRING": {"masses": n, "M": m * n, "K": K, "Z": Z}}, n, m


def _row(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Masses and cells in a row, each link with its own damping."""
    n = dice.integer(5, 40)
    M, f = dice.by_ratio(0.1, 10.0), dice.by_ratio(300.0, 4000.0)
    K = _stiffness(M, f)
    modules["e"] = {"SOL": {}}
    for i in range(n):
        point = {"M": M * dice.between(0.5, 2.0), "X0": dice.choose(0.0, 1e-3)}
        if dice.integer(0, 2) == 0:
            point |= {"K": K * dice.between(0.0, 0.5), "Z": K * dice.by_ratio(1e-3, 1.0)}
        modules[f"m{i}"] = {"CEL" if "K" in point else "MAS": point}
    for i, a in enumerate(["e", *(f"m{i}" for i in range(n - 1))]):
        link = {"K": K * dice.between(0.5, 2.0), "Z": K * dice.by_ratio(1e-3, 1.0)}
        modules[f"r{i}"] = {"REF": {"between": [a, f"m{i}"], **link}}
    _knock(dice, score, f"s.m{dice.integer(0, n - 1)}", M, dice.between(0.1, 1.0))
    listen_to(out, "m0", f"m{n - 1}")


def _damped_body(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A string that is struck, with dampers at points."""
    modules["b"], n, m = _string(dice)
    modules["w"] = {"SOL": {}}
    for i in range(dice.integer(0, 3)):
        Z = m * dice.by_ratio(1e-4, 1e-1)
        modules[f"d{i}"] = {"FRO": {"between": ["w", f"b.{dice.integer(0, n - 1)}"], "Z": Z}}
    _knock(dice, score, f"s.b.{dice.integer(0, n - 1)}", m, dice.between(0.1, 1.0))
    listen_to(out, f"b.{dice.integer(0, n - 1)}")


def _contact(dice: Dice, M: float) -> Modules:
    """A contact that a mass M closes for 0.2 to 3 ms."""
    K = _stiffness(M, 0.5 / dice.by_ratio(2e-4, 3e-3))
    contact = {"K": K, "clamp": dice.choose(False, True), "Z": K * dice.choose(0.0, 1.0)}
    if contact["Z"] == 0.0:
        contact |= {"contact": dice.choose("plain", "exact")}
    return contact


def _hammer(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A mass that flies against a string."""
    modules["b"], n, m = _string(dice)
    M = m * dice.by_ratio(0.5, 20.0)
    modules["h"] = {"MAS": {"M": M, "V0": dice.by_ratio(0.3, 4.0)}}
    target, gap = f"b.{dice.integer(0, n - 1)}", dice.between(1e-4, 2e-3)
    contact = _contact(dice, M * m / (M + m))
    modules["c"] = {"BUT": {"between": ["h", target], "gap": gap, **contact}}
    listen_to(out, target)


def _chain(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Cells in a row that hit one another."""
    n = dice.integer(3, 6)
    for i in range(n):
        M = dice.by_ratio(0.1, 10.0)
        K = _stiffness(M, dice.by_ratio(40.0, 1500.0))
        cell = {"M": M, "K": K, "Z": M * dice.by_ratio(1e-5, 1e-3)}
        modules[f"m{i}"] = {"CEL": cell | {"V0": 1.0 if i == 0 else 0.0}}
    for i in range(1, n):
        least = min(modules[f"m{j}"]["CEL"]["M"] for j in (i - 1, i))
        ends, gap = [f"m{i - 1}", f"m{i}"], dice.between(1e-5, 3e-4)
        modules[f"c{i}"] = {"BUT": {"between": ends, "gap": gap, **_contact(dice, 0.5 * least)}}
    listen_to(out, *(f"m{i}" for i in range(n)))


def _bow(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A bow on a string; its speeds are metres a frame."""
    modules["b"], n, m = _string(dice)
    modules["w"] = {"SOL": {}}
    a = dice.by_ratio(10.0, 100.0) * RATE**2
    F = m * dice.by_ratio(300.0, 6000.0) / RATE / np.sqrt(2.0 * a * np.e)
    law = {"damping": "bow", "F": float(F), "a": a, "u": dice.between(0.05, 0.4) / RATE}
    modules["l"] = {"LNL": {"between": ["w", f"b.{dice.integer(1, n - 2)}"], **law}}
    listen_to(out, f"b.{dice.integer(0, n - 1)}")


def _slow_row(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A row of heavy masses with a rate of its own, which pulls a string by a spring."""
    every, n = dice.choose(5, 10, 20, 42), dice.integer(3, 20)
    M = dice.by_ratio(10.0, 1000.0)
    row: Modules = {"ground": {"SOL": {}}}
    for i in range(n):
        K = _stiffness(M, dice.by_ratio(5.0, 60.0))
        row[f"m{i}"] = {"MAS": {"M": M * dice.between(0.5, 2.0)}}
        link = {"K": K, "Z": M * dice.by_ratio(1e-6, 1e-3)}
        row[f"r{i}"] = {"REF": {"between": [f"m{i - 1}" if i else "ground", f"m{i}"], **link}}
    slow = {"units": "ca", "at": f"{RATE}Hz", "rate": f"{RATE // every}Hz", "modules": row}
    score["instruments"] = {"slow": slow} | score["instruments"]
    modules["b"], count, m = _string(dice)
    target = f"b.{dice.integer(0, count - 1)}"
    K = _stiffness(m, dice.by_ratio(50.0, 2000.0))
    modules["c"] = {"REF": {"between": [f"slow.m{n - 1}", target], "K": K, "Z": 0.1 * K}}
    _knock(dice, score, "slow.m0", M, dice.between(0.1, 1.0))
    listen_to(out, target)


def _key(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A key in SI units that a hand leads, joined to a string by a spring, or striking it."""
    M, K = dice.by_ratio(0.05, 0.5), dice.by_ratio(20.0, 200.0)
    score["keys"] = {"k1": {"M": M, "K": K, "Z": dice.between(0.1, 2.0)}}
    modules["b"], n, m = _string(dice)
    target, peak = f"b.{dice.integer(0, n - 1)}", dice.between(2e-3, 6e-3)
    if dice.integer(0, 1):
        spring = {"K": _stiffness(m, dice.by_ratio(20.0, 1000.0)), "Z": 0.0}
        modules["c"] = {"REF": {"between": ["k1", target], **spring}}
    else:
        gap = 0.5 * peak
        modules["c"] = {"BUT": {"between": ["k1", target], "gap": gap, **_contact(dice, m)}}
    first, second = dice.integer(4, 8), dice.integer(10, 16)
    path = f"0m@0 smooth {peak}m@{first / 100}s 0m@{second / 100}s"
    score["gestures"] = {"g": {"notation": path, "touch": "open"}}
    score["players"] = {"p": {"key": "k1"}}
    score["parts"] = {"p": [{"at": "0.05s", "play": "g"}]}
    listen_to(out, target, "k1")
