"""Random scenes of parameters that glide, couplings that come and go, values that follow a mass,
and points between masses.
"""

import numpy as np

from accuracy.dice import (
    Dice,
    Modules,
    add_strike,
    drawn_cell,
    drawn_contact,
    drawn_string,
    listen_to,
)


def glide_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A parameter of a cell, of springs, a string, a contact or a friction glides, or two keys are
    coupled for a while.
    """
    what = dice.choose("cell", "springs", "string", "contact", "friction", "coupling")
    if what == "coupling":
        _coupling(dice, score, modules, out)
        return
    if what == "string":
        modules["b"], n = drawn_string(dice)
        body = modules["b"]["STRING"]
        add_strike(dice, score, f"s.b.{dice.integer(0, n - 1)}", body["M"] / n * 0.3)
        _glide_tuning(dice, score, "s.b", body, ("f", "t60"))
        listen_to(out, f"b.{dice.integer(0, n - 1)}")
        return
    x = dice.between(0.3e-3, 3e-3)
    modules["m"] = drawn_cell(dice, X0=x)
    cell = modules["m"]["CEL"]
    k = float(cell["M"] * (2.0 * np.pi * cell["f"]) ** 2)
    speed = x * float(2.0 * np.pi * cell["f"])
    listen_to(out, "m")
    if what == "cell":
        _glide_tuning(dice, score, "s.m", cell, ("f", "t60", "M"))
        return
    modules["w"] = {"SOL": {}}
    ends = {"between": ["w", "m"]}
    if what == "springs":
        # Two cells on a spring, and a spring from the second to the ground.
        modules["n"] = drawn_cell(dice)
        K, Z = k * dice.by_ratio(0.1, 2.0), cell["M"] * dice.between(0.1, 30.0)
        modules["r"] = {"REF": {"between": ["m", "n"], "K": K, "Z": Z}}
        modules["e"] = {"RES": {"between": ["w", "n"], "K": k * dice.by_ratio(0.1, 1.0)}}
        name, parameter = dice.choose(("r", "K"), ("r", "Z"), ("e", "K"))
        first = {"r": {"K": K, "Z": Z}, "e": modules["e"]["RES"]}[name][parameter]
        unit = "N/m" if parameter == "K" else "Ns/m"
        _glide(dice, score, f"s.{name}.{parameter}", first * dice.by_ratio(0.3, 4.0), unit)
        listen_to(out, "n")
    elif what == "contact":
        contact = drawn_contact(dice, cell["M"], speed)
        modules["c"] = {"BUT": {**ends, "gap": x * dice.between(-0.5, 0.7), **contact}}
        _glide(dice, score, "s.c.K", contact["K"] * dice.by_ratio(0.3, 8.0), "N/m")
    else:
        F = k * x * dice.by_ratio(0.003, 0.1)
        modules["d"] = {"DRY": {"to": "m", "F": F}}
        _glide(dice, score, "s.d.F", F * dice.by_ratio(0.3, 4.0), "N")


def _glide(dice: Dice, score: Modules, name: str, last: float, unit: str) -> None:
    """One glide; of three one begins after the first 0.3 s, which a pilot plays."""
    begin = dice.between(0.31, 0.5) if dice.integer(0, 2) == 0 else dice.between(0.01, 0.2)
    line = {"set": name, "to": f"{last!r}{unit}", "at": f"{begin:.4f}s"}
    over = f"{dice.between(0.05, 0.3):.4f}s"
    score.setdefault("automation", []).append(
        {**line, "over": over, "curve": dice.choose("line", "smooth")}
    )


def _glide_tuning(
    dice: Dice, score: Modules, name: str, tuned: Modules, parameters: tuple[str, ...]
) -> None:
    parameter = dice.choose(*parameters)
    unit = {"f": "Hz", "t60": "s", "M": "kg"}[parameter]
    last = tuned[parameter] * dice.by_ratio(0.5, 2.0)
    _glide(dice, score, f"{name}.{parameter}", last, unit)


def _coupling(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Two keys that a spring couples for a while; one of them strikes a cell."""
    score |= {"keys": {}, "gestures": {}, "players": {}, "parts": {}}
    for i in range(2):
        M, K = dice.by_ratio(0.05, 0.5), dice.by_ratio(20.0, 200.0)
        score["keys"][f"k{i}"] = {"M": M, "K": K, "Z": dice.between(0.1, 3.0)}
    peak = dice.between(2e-3, 6e-3)
    path = f"0m@0 smooth {peak}m@{dice.integer(8, 16) / 100}s 0m@{dice.integer(20, 30) / 100}s"
    score["gestures"]["g"] = {"notation": path, "touch": "open"}
    score["players"]["p"] = {"key": "k0"}
    score["parts"]["p"] = [{"at": "0.01s", "play": "g"}]
    spring = {"K": dice.by_ratio(20.0, 500.0), "Z": dice.between(0.0, 1.0)}
    begin = dice.between(0.02, 0.15)
    couple = {"couple": ["k0", "k1"], "REF": spring, "at": f"{begin:.4f}s"}
    if dice.integer(0, 1):
        couple["until"] = f"{begin + dice.between(0.05, 0.3):.4f}s"
    score["duet"] = [couple]
    modules["m"] = drawn_cell(dice)
    m = modules["m"]["CEL"]["M"]
    if dice.integer(0, 1):
        link = {"K": m * dice.by_ratio(1e4, 1e6), "Z": m * dice.between(0.0, 20.0)}
        modules["r"] = {"REF": {"between": ["k1", "m"], **link}}
    else:
        contact = drawn_contact(dice, m, 0.1)
        modules["r"] = {"BUT": {"between": ["k1", "m"], "gap": 0.1 * peak, **contact}}
    listen_to(out, "m", "k1")


def follow_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A spring, a damper or a mass whose value follows a mass that moves."""
    x = dice.between(0.3e-3, 3e-3)
    modules["m"] = drawn_cell(dice, X0=x)
    M, f = (modules["m"]["CEL"][name] for name in ("M", "f"))
    k = float(M * (2.0 * np.pi * f) ** 2)
    # The guide drifts, or swings slowly.
    span = dice.between(1e-3, 1e-2)
    if dice.integer(0, 1):
        modules["p"] = {"MAS": {"M": 1.0, "V0": span * dice.between(0.5, 4.0)}}
        offset = 0.0
    else:
        swing = {"f": dice.by_ratio(2.0, 30.0), "t60": dice.between(0.5, 5.0)}
        modules["p"] = {"CEL": {"M": 1.0, "X0": 0.45 * span, **swing}}
        offset = 0.5 * span
    place = {"of": "p", "span": f"{span!r}m", "offset": f"{offset!r}m"}
    modules["w"] = {"SOL": {}}
    if dice.choose("link", "link", "mass") == "mass":
        K = k * dice.by_ratio(0.2, 2.0)
        loads = {name: f"{M * dice.by_ratio(0.3, 3.0)!r}kg" for name in ("from", "to")}
        modules["n"] = {"MAS": {"M": M, "follows": {"M": {**place, **loads}}}}
        modules["r"] = {"REF": {"between": ["m", "n"], "K": K, "Z": M * dice.between(0.0, 5.0)}}
        listen_to(out, "m", "n")
        return
    K, Z = k * dice.by_ratio(0.05, 1.0), M * dice.between(0.5, 30.0)
    link = {"law": "k*d", "damping": "z*v", "k": f"{K!r}N/m", "z": f"{Z!r}Ns/m"}
    constant = dice.choose("k", "z")
    del link[constant]  # it is where the guide says
    value, unit = {"k": (K, "N/m"), "z": (Z, "Ns/m")}[constant]
    ends = {end: f"{value * dice.by_ratio(0.2, 5.0)!r}{unit}" for end in ("from", "to")}
    modules["l"] = {
        "LNL": {"between": ["w", "m"], **link, "follows": {constant: {**place, **ends}}}
    }
    listen_to(out, "m")


def proxy_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A contact or a spring at a point between masses of a string, which stays or slides."""
    modules["b"], n = drawn_string(dice)
    m, omega = modules["b"]["STRING"]["M"] / n, 2.0 * np.pi * modules["b"]["STRING"]["f"]
    swing = dice.by_ratio(1e-4, 1e-3)
    speed = float(omega * swing)
    proxy: Modules = {"of": "b"}
    if dice.integer(0, 1):
        proxy["at"] = round(dice.between(0.5, n - 1.5), 3)
    else:
        # A finger slides from the first masses to the last ones in 0.2 to 2 s.
        modules["g"] = {"MAS": {"M": 0.05, "V0": dice.by_ratio(0.3, 3.0)}}
        proxy |= {"follows": "g", "span": "0.65m", "offset": f"{dice.between(0.0, 0.2)!r}m"}
    modules["x"] = {"PROXY": proxy}
    modules["o"] = dice.choose({"SOL": {}}, drawn_cell(dice))
    if dice.integer(0, 1):
        contact = drawn_contact(dice, m, speed)
        contact.pop("contact", None)  # `exact` is plain at a proxy
        gap = swing * dice.between(0.0, 0.4)
        modules["c"] = {"BUT": {"between": ["o", "x"], "gap": gap, **contact}}
    else:
        K = m * dice.by_ratio(1e4, 1e6)
        modules["c"] = {"REF": {"between": ["o", "x"], "K": K, "Z": m * dice.between(0.0, 20.0)}}
    add_strike(dice, score, f"s.b.{dice.integer(n // 2, n - 1)}", m * speed * 10.0)
    listen_to(out, f"b.{dice.integer(0, n - 1)}", "x")
