"""Draws of one seed, and what scenes of several families are made of."""

from typing import Any

import numpy as np

Modules = dict[str, Any]


class Dice:
    """Draws of one seed."""

    def __init__(self, family: str, seed: int) -> None:
        self.rng = np.random.default_rng([seed, *family.encode()])

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def by_ratio(self, low: float, high: float) -> float:
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def integer(self, low: int, high: int) -> int:
        """low … high, both inclusive."""
        return int(self.rng.integers(low, high + 1))

    def choose(self, *options: Any) -> Any:
        return options[int(self.rng.integers(len(options)))]


def listen_to(out: Modules, *names: str) -> None:
    for name in names:
        out[f"o{len(out)}"] = {"SOX": name}


def add_strike(
    dice: Dice, score: Modules, to: str, impulse: float, time: float | None = None
) -> None:
    when = f"{dice.between(0.001, 0.05) if time is None else time:.6f}s"
    score.setdefault("strikes", {})[f"k{len(score.get('strikes', {}))}"] = {
        "to": to,
        "at": when,
        "impulse": f"{impulse!r}Ns",
    }


def drawn_string(dice: Dice) -> tuple[Modules, int]:
    n = dice.integer(5, 40)
    # The highest mode stays below 8 kHz.
    f = dice.by_ratio(40.0, min(800.0, 8000.0 / n))
    body = {"masses": n, "M": dice.by_ratio(1e-3, 5e-2), "f": f, "t60": dice.by_ratio(0.3, 8.0)}
    stiffness = dice.choose(0.0, 0.0, 0.03)
    return {"STRING": body | {"stiffness": stiffness}}, n


def drawn_body(dice: Dice) -> tuple[Modules, int, float]:
    """A string or a plate, its number of masses, and the mass of each [kg]."""
    if dice.integer(0, 2):
        built, n = drawn_string(dice)
        return built, n, built["STRING"]["M"] / n
    radius = dice.integer(1, 3)
    n = 1 + 3 * radius * (radius + 1)
    M = dice.by_ratio(1e-2, 1.0)
    body = {"shape": "hex", "radius": radius, "M": M, "f": dice.by_ratio(60.0, 400.0)}
    rim = dice.choose("free", "fixed")
    return {"PLATE": body | {"t60": dice.by_ratio(0.5, 8.0), "rim": rim}}, n, M / n


def drawn_cell(dice: Dice, **start: float) -> Modules:
    M, f = dice.by_ratio(1e-3, 6e-2), dice.by_ratio(40.0, 1500.0)
    return {"CEL": {"M": M, "f": f, "t60": dice.by_ratio(0.1, 3.0), **start}}


def drawn_contact(dice: Dice, light: float, speed: float) -> Modules:
    """A contact that lasts 0.3 to 3 ms for a mass at a speed."""
    exponent = dice.choose(1.0, 1.5, 2.3)
    omega = np.pi / dice.by_ratio(3e-4, 3e-3)
    # The equivalent spring has the same stiffness at the depth speed/omega.
    K = light * omega**2 * (speed / omega) ** (1.0 - exponent)
    Z = dice.choose(0.0, 0.0, 0.1 * light * omega)
    output = {"K": float(K), "Z": Z, "exponent": exponent, "clamp": dice.choose(False, True)}
    if Z == 0.0:
        output |= {"contact": dice.choose("plain", "exact")}
    return output
