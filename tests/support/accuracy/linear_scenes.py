"""Random scenes of springs, dampers, strings and plates."""

import numpy as np

from accuracy.dice import Dice, Modules, add_strike, drawn_body, listen_to


def mesh_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Masses and cells in a row, some joined across, each link with its own damping."""
    n = dice.integer(5, 40)
    M, f = dice.by_ratio(2e-3, 5e-2), dice.by_ratio(200.0, 2000.0)
    K = M * (2.0 * np.pi * f) ** 2
    modules["e"] = {"SOL": {}}
    for i in range(n):
        point = {
            "M": M * dice.between(0.5, 2.0),
            "X0": dice.choose(0.0, 1e-3 * dice.between(-1, 1)),
        }
        if dice.integer(0, 2) == 0:
            point |= {"K": K * dice.between(0.0, 0.5), "Z": dice.by_ratio(1e-7, 1e-5) * K}
        modules[f"m{i}"] = {"CEL" if "K" in point else "MAS": point}
    names = ["e", *(f"m{i}" for i in range(n))]
    pairs = [(i, i + 1) for i in range(n)]
    pairs += [(a, b) for a, b in (sorted(dice.rng.choice(n + 1, 2, False)) for _ in range(n // 4))]
    for i, (a, b) in enumerate(pairs):
        Z = K * dice.by_ratio(1e-7, 1e-5) * dice.integer(0, 1)
        link = {"between": [names[a], names[b]], "K": K * dice.between(0.5, 2.0), "Z": Z}
        modules[f"r{i}"] = {"REF": link}
    add_strike(dice, score, f"s.m{dice.integer(0, n - 1)}", M * dice.between(0.1, 1.0))
    listen_to(out, "m0", f"m{n - 1}")


def damped_body_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A string or a plate that is struck, with dampers at points."""
    modules["b"], n, m = drawn_body(dice)
    modules["w"] = {"SOL": {}}
    for i in range(dice.integer(0, 2)):
        Z = m * dice.by_ratio(1.0, 100.0)
        modules[f"d{i}"] = {"FRO": {"between": ["w", f"b.{dice.integer(0, n - 1)}"], "Z": Z}}
    add_strike(dice, score, f"s.b.{dice.integer(0, n - 1)}", m * dice.between(0.1, 1.0))
    listen_to(out, f"b.{dice.integer(0, n - 1)}")


def linear_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Masses that springs and dampers of all strengths join, tied to a wall or to nothing."""
    n = dice.integer(2, 30)
    M, f = dice.by_ratio(2e-3, 5e-2), dice.by_ratio(100.0, 2000.0)
    omega = 2.0 * np.pi * f
    K, Z = M * omega**2, M * omega
    is_twin = dice.integer(0, 1)  # all masses and springs alike: poles that are equal or nearly so
    modules["w"] = {"SOL": {}}
    for i in range(n):
        m = M if is_twin else M * dice.between(0.5, 2.0)
        start = {"X0": 1e-3 * dice.between(-1, 1), "V0": dice.choose(0.0, dice.between(-1, 1))}
        modules[f"m{i}"] = {"MAS": {"M": m, **start}}
    for i in range(1, n):
        k = K if is_twin else K * dice.by_ratio(0.1, 3.0)
        kind = dice.choose("RES", "RES", "REF")
        link = {"between": [f"m{dice.integer(0, i - 1)}", f"m{i}"], "K": k}
        if kind == "REF":
            link["Z"] = Z * dice.by_ratio(1e-4, 10.0)
        modules[f"r{i}"] = {kind: link | {"rest": dice.choose(0.0, 1e-3)}}
    for i in range(dice.integer(1, 3)):
        a, b = dice.rng.choice(n, 2, False)
        ends = [dice.choose("w", f"m{a}"), f"m{b}"]
        modules[f"d{i}"] = {"FRO": {"between": ends, "Z": Z * dice.by_ratio(1e-4, 100.0)}}
    if dice.integer(0, 1):
        modules["t"] = {"RES": {"between": ["w", f"m{dice.integer(0, n - 1)}"], "K": K}}
    add_strike(dice, score, f"s.m{dice.integer(0, n - 1)}", M * dice.between(0.1, 1.0))
    listen_to(out, "m0", f"m{n - 1}")
    out[f"o{len(out)}"] = {"SOF": {next(iter(modules["r1"])): "r1"}}
