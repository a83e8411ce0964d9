"""Random scenes of bows, hardening, ropes, notches and friction."""

import numpy as np

from accuracy.dice import Dice, Modules, add_strike, drawn_body, drawn_cell, drawn_string, listen_to


def bow_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A bow on a string."""
    modules["b"], n = drawn_string(dice)
    modules["w"] = {"SOL": {}}
    # The steepest slope is limited to a part of what the mass can follow stably.
    m, a = modules["b"]["STRING"]["M"] / n, dice.by_ratio(10.0, 100.0)
    F = m * dice.by_ratio(300.0, 6000.0) / np.sqrt(2.0 * a * np.e)
    law = {"damping": "bow", "F": float(F), "a": a, "u": dice.between(0.05, 0.4)}
    modules["l"] = {"LNL": {"between": ["w", f"b.{dice.integer(1, n - 2)}"], **law}}
    listen_to(out, f"b.{dice.integer(0, n - 1)}")


def hard_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A body whose links harden, or one mass on a cubic spring."""
    if dice.integer(0, 1):
        modules["b"], n, m = drawn_body(dice)
        ((_, body),) = modules["b"].items()
        speed = dice.between(0.1, 1.0)
        # The hardening adds a comparable stiffness at the elongations that a strike causes.
        body["hardening"] = m * (2.0 * np.pi * body["f"]) ** 2 * dice.by_ratio(1e6, 1e8)
        add_strike(dice, score, f"s.b.{n // 2}", m * speed)
        listen_to(out, f"b.{dice.integer(0, n - 1)}")
        return
    m, x = dice.by_ratio(2e-3, 6e-2), dice.between(0.2e-3, 2e-3)
    k = m * (2.0 * np.pi * dice.by_ratio(100.0, 1000.0)) ** 2
    law = {"law": "cubic", "damping": "cubic", "k": float(k), "q": float(k / x**2)}
    modules["e"] = {"SOL": {}}
    modules["m"] = {"MAS": {"M": m, "X0": x}}
    modules["l"] = {"LNL": {"between": ["e", "m"], **law, "z": dice.between(0.0, 0.2)}}
    listen_to(out, "m")


def law_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A cell held by a rope, a notch or dry friction."""
    x = dice.between(0.5e-3, 3e-3)
    modules["m"] = drawn_cell(dice, X0=x)
    M, f = (modules["m"]["CEL"][name] for name in ("M", "f"))
    k = float(M * (2.0 * np.pi * f) ** 2)
    rope = {"law": "rope", "damping": "rope", "k": k * dice.by_ratio(0.3, 10.0), "z": M * 10.0}
    notch = {"law": "detent", "F": k * x * dice.between(0.2, 2.0), "w": x * dice.between(0.1, 0.5)}
    dry = {
        "damping": "coulomb",
        "F": k * x * dice.by_ratio(0.003, 0.1),
        "s": dice.by_ratio(0.02, 0.2),
    }
    modules["w"] = {"SOL": {}}
    rest = x * dice.between(0.0, 0.6)
    modules["l"] = {"LNL": {"between": ["w", "m"], "rest": rest, **dice.choose(rope, notch, dry)}}
    listen_to(out, "m")


def _rubbed(dice: Dice, modules: Modules) -> tuple[float, float, list[str]]:
    """A system that friction rubs: its mass [kg], the force with which it swings [N], the ends.

    A block on a belt, a displaced cell on the ground, a point of a string, or two cells.
    """
    what = dice.integer(0, 3)
    if what == 0:
        modules["m"] = drawn_cell(dice)
        M, f = (modules["m"]["CEL"][name] for name in ("M", "f"))
        speed = dice.by_ratio(0.01, 0.5)
        modules["w"] = {"MAS": {"M": 1000.0, "V0": speed}}
        return M, M * 2.0 * np.pi * f * speed, ["w", "m"]
    if what == 1:
        x = dice.between(0.3e-3, 3e-3)
        modules["m"] = drawn_cell(dice, X0=x)
        M, f = (modules["m"]["CEL"][name] for name in ("M", "f"))
        modules["w"] = {"SOL": {}}
        return M, M * (2.0 * np.pi * f) ** 2 * x, ["w", "m"]
    if what == 2:
        modules["m"], n = drawn_string(dice)
        body = modules["m"]["STRING"]
        m, speed, bow = body["M"] / n, dice.by_ratio(0.02, 0.5), f"m.{dice.integer(1, n - 2)}"
        modules["w"] = {"MAS": {"M": 1000.0, "V0": speed}}
        return m, 2.0 * body["M"] * body["f"] * speed, ["w", bow]
    x = dice.between(0.3e-3, 3e-3)
    modules["m"], modules["w"] = drawn_cell(dice, X0=x), drawn_cell(dice)
    M, f = (modules["m"]["CEL"][name] for name in ("M", "f"))
    return M, M * (2.0 * np.pi * f) ** 2 * x, ["w", "m"]


def dry_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Dry friction that holds and slides."""
    m, force, ends = _rubbed(dice, modules)
    F = float(force * dice.by_ratio(0.01, 2.0))
    friction = {"F": F}
    if dice.integer(0, 1):
        friction |= {"static": F * dice.between(1.0, 2.0), "speed": dice.by_ratio(0.003, 0.1)}
    is_ground = modules["w"] == {"SOL": {}}
    modules["l"] = {"DRY": ({"to": ends[1]} if is_ground else {"between": ends}) | friction}
    _strike_rubbed(dice, score, m, force, ends[1])
    listen_to(out, ends[1])


def bristle_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Friction with memory that makes no energy; one in three is Dahl's."""
    m, force, ends = _rubbed(dice, modules)
    F = float(force * dice.by_ratio(0.01, 1.0))
    # The bristles' stiffness makes the mass oscillate at 200 Hz to 3 kHz.
    sigma0 = float(m * (2.0 * np.pi * dice.by_ratio(200.0, 3000.0)) ** 2)
    friction = {"sigma0": sigma0, "Fc": F}
    if dice.integer(0, 2):
        static = F * dice.between(1.0, 2.0)
        damping = float(np.sqrt(sigma0 * m)) * dice.by_ratio(0.02, 1.0)
        least = damping * (static - F) / F
        friction |= {"Fs": static, "vs": dice.by_ratio(0.003, 0.1), "sigma1": damping}
        friction["sigma2"] = least * dice.between(1.0, 2.0)
    modules["l"] = {"BRISTLE": {"between": ends, **friction}}
    _strike_rubbed(dice, score, m, force, ends[1])
    listen_to(out, ends[1])


def _strike_rubbed(dice: Dice, score: Modules, m: float, force: float, to: str) -> None:
    """Strike at a hundredth of a second, which falls on a frame at every rate.

    Between two frames a strike on a joined mass is split evenly (docs/numerics.md).
    """
    if dice.integer(0, 1):
        impulse = min(m * dice.between(0.05, 0.5), float(force) * 1e-3)
        add_strike(dice, score, f"s.{to}", impulse, dice.integer(1, 5) / 100)
