"""Random scenes of a family and a seed: the same pair gives the same text."""

from collections.abc import Callable
from typing import Any

import numpy as np
import yaml

Modules = dict[str, Any]
_UNITS = (
    ("M", "kg"),
    ("f", "Hz"),
    ("t60", "s"),
    ("gap", "m"),
    ("rest", "m"),
    ("V0", "m/s"),
    ("X0", "m"),
)


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


def text(family: str, seed: int) -> str:
    """The score of a scene."""
    dice = Dice(family, seed)
    score: dict[str, Any] = {
        "ergon": 1,
        "title": f"{family}-{seed}",
        "rates": {"audio": f"{dice.choose(32000, 44100, 48000)}Hz"},
        "tempo": [{"at": "1|1", "bpm": 60, "meter": "4/4"}],
        "render": {"bits": "float", "tail": f"{dice.between(0.2, 0.5):.3f}s"},
    }
    instrument: dict[str, Any] = {"modules": {}, "out": {}}
    score["instruments"] = {"s": instrument}
    FAMILIES[family](dice, score, instrument["modules"], instrument["out"])
    for module in instrument["modules"].values():
        for fields in module.values():
            bare = [(n, u) for n, u in _UNITS if isinstance(fields.get(n), int | float)]
            fields |= {name: f"{fields[name]!r}{unit}" for name, unit in bare}
    for key in score.get("keys", {}).values():
        key |= {"M": f"{key['M']!r}kg"} if "M" in key else {}
    n_out = len(instrument["out"])
    route = [{"from": f"s.{name}", "to": [i + 1]} for i, name in enumerate(instrument["out"])]
    score["mix"] = {"channels": n_out, "route": route}
    return str(yaml.safe_dump(score, sort_keys=False, default_flow_style=None, width=1000))


def _hear(out: Modules, *names: str) -> None:
    for name in names:
        out[f"o{len(out)}"] = {"SOX": name}


def _strike(dice: Dice, score: Modules, to: str, impulse: float, time: float | None = None) -> None:
    when = f"{dice.between(0.001, 0.05) if time is None else time:.6f}s"
    score.setdefault("strikes", {})[f"k{len(score.get('strikes', {}))}"] = {
        "to": to,
        "at": when,
        "impulse": f"{impulse!r}Ns",
    }


def _string(dice: Dice) -> tuple[Modules, int]:
    n = dice.integer(5, 40)
    # The highest mode stays below 8 kHz.
    f = dice.by_ratio(40.0, min(800.0, 8000.0 / n))
    body = {"masses": n, "M": dice.by_ratio(1e-3, 5e-2), "f": f, "t60": dice.by_ratio(0.3, 8.0)}
    stiffness = dice.choose(0.0, 0.0, 0.03)
    return {"STRING": body | {"stiffness": stiffness}}, n


def _body(dice: Dice) -> tuple[Modules, int, float]:
    """A string or a plate, its number of masses, and the mass of each [kg]."""
    if dice.integer(0, 2):
        built, n = _string(dice)
        return built, n, built["STRING"]["M"] / n
    radius = dice.integer(1, 3)
    n = 1 + 3 * radius * (radius + 1)
    M = dice.by_ratio(1e-2, 1.0)
    body = {"shape": "hex", "radius": radius, "M": M, "f": dice.by_ratio(60.0, 400.0)}
    rim = dice.choose("free", "fixed")
    return {"PLATE": body | {"t60": dice.by_ratio(0.5, 8.0), "rim": rim}}, n, M / n


def _cell(dice: Dice, **start: float) -> Modules:
    M, f = dice.by_ratio(1e-3, 6e-2), dice.by_ratio(40.0, 1500.0)
    return {"CEL": {"M": M, "f": f, "t60": dice.by_ratio(0.1, 3.0), **start}}


def _mesh(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
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
    _strike(dice, score, f"s.m{dice.integer(0, n - 1)}", M * dice.between(0.1, 1.0))
    _hear(out, "m0", f"m{n - 1}")


def _damped_body(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A string or a plate that is struck, with dampers at points."""
    modules["b"], n, m = _body(dice)
    modules["w"] = {"SOL": {}}
    for i in range(dice.integer(0, 2)):
        Z = m * dice.by_ratio(1.0, 100.0)
        modules[f"d{i}"] = {"FRO": {"between": ["w", f"b.{dice.integer(0, n - 1)}"], "Z": Z}}
    _strike(dice, score, f"s.b.{dice.integer(0, n - 1)}", m * dice.between(0.1, 1.0))
    _hear(out, f"b.{dice.integer(0, n - 1)}")


def _linear(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
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
    _strike(dice, score, f"s.m{dice.integer(0, n - 1)}", M * dice.between(0.1, 1.0))
    _hear(out, "m0", f"m{n - 1}")
    out[f"o{len(out)}"] = {"SOF": {next(iter(modules["r1"])): "r1"}}


def _contact(dice: Dice, light: float, speed: float) -> Modules:
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


def _hammer(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A mass that flies against a cell or a body."""
    if dice.integer(0, 1):
        modules["t"] = _cell(dice)
        target, m = "t", modules["t"]["CEL"]["M"]
    else:
        modules["t"], n, m = _body(dice)
        target = f"t.{dice.integer(0, n - 1)}"
    M, speed = dice.by_ratio(2e-3, 2e-2), dice.by_ratio(0.3, 4.0)
    modules["h"] = {"MAS": {"M": M, "V0": speed}}
    contact = _contact(dice, M * m / (M + m), speed)
    gap = dice.between(1e-4, 2e-3)
    modules["c"] = {"BUT": {"between": ["h", target], "gap": gap, **contact}}
    _hear(out, target)


def _bridge(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A string over a curved obstacle, which holds still or is a cell: contacts at many points."""
    n = dice.integer(24, 72)
    f, M = dice.by_ratio(40.0, min(400.0, 12000.0 / n)), dice.by_ratio(1e-3, 2e-2)
    body = {"masses": n, "M": M, "f": f, "t60": dice.by_ratio(1.0, 8.0)}
    modules["b"] = {"STRING": body}
    modules["o"] = dice.choose({"SOL": {}}, _cell(dice))
    first, points = dice.integer(0, n // 3), dice.integer(2, n // 2)
    swing = dice.by_ratio(1e-4, 2e-3)
    speed = 2.0 * np.pi * f * swing
    far = swing * (first + points) / n  # about how far the string swings where the obstacle ends
    profile = {"depth": f"{far * dice.by_ratio(0.02, 0.5)!r}m", "power": dice.choose(1.0, 2.0)}
    if dice.integer(0, 1):
        profile["least"] = f"{far * dice.between(0.0, 0.1)!r}m"
    contact = _contact(dice, M / n, speed)
    ends = ["o", f"b.{first}..{first + points - 1}"]
    modules["c"] = {"BUT": {"between": ends, "gap": profile, **contact}}
    _strike(dice, score, f"s.b.{dice.integer(n // 2, n - 1)}", M * speed)
    _hear(out, f"b.{dice.integer(n // 2, n - 1)}")


def _chain(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Cells in a row that hit one another."""
    n = dice.integer(3, 6)
    for i in range(n):
        modules[f"m{i}"] = _cell(dice, V0=dice.between(0.3, 2.0) if i == 0 else 0.0)
    for i in range(1, n):
        a, b = (modules[f"m{j}"]["CEL"]["M"] for j in (i - 1, i))
        contact = _contact(dice, a * b / (a + b), 0.5)
        gap = dice.between(1e-5, 3e-4)
        modules[f"c{i}"] = {"BUT": {"between": [f"m{i - 1}", f"m{i}"], "gap": gap, **contact}}
    _hear(out, *(f"m{i}" for i in range(n)))


def _bow(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A bow on a string."""
    modules["b"], n = _string(dice)
    modules["w"] = {"SOL": {}}
    # The steepest slope is limited to a part of what the mass can follow stably.
    m, a = modules["b"]["STRING"]["M"] / n, dice.by_ratio(10.0, 100.0)
    F = m * dice.by_ratio(300.0, 6000.0) / np.sqrt(2.0 * a * np.e)
    law = {"damping": "bow", "F": float(F), "a": a, "u": dice.between(0.05, 0.4)}
    modules["l"] = {"LNL": {"between": ["w", f"b.{dice.integer(1, n - 2)}"], **law}}
    _hear(out, f"b.{dice.integer(0, n - 1)}")


def _hard(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A body whose links harden, or one mass on a cubic spring."""
    if dice.integer(0, 1):
        modules["b"], n, m = _body(dice)
        ((_, body),) = modules["b"].items()
        speed = dice.between(0.1, 1.0)
        # The hardening adds a comparable stiffness at the elongations that a strike causes.
        body["hardening"] = m * (2.0 * np.pi * body["f"]) ** 2 * dice.by_ratio(1e6, 1e8)
        _strike(dice, score, f"s.b.{n // 2}", m * speed)
        _hear(out, f"b.{dice.integer(0, n - 1)}")
        return
    m, x = dice.by_ratio(2e-3, 6e-2), dice.between(0.2e-3, 2e-3)
    k = m * (2.0 * np.pi * dice.by_ratio(100.0, 1000.0)) ** 2
    law = {"law": "cubic", "damping": "cubic", "k": float(k), "q": float(k / x**2)}
    modules["e"] = {"SOL": {}}
    modules["m"] = {"MAS": {"M": m, "X0": x}}
    modules["l"] = {"LNL": {"between": ["e", "m"], **law, "z": dice.between(0.0, 0.2)}}
    _hear(out, "m")


def _law(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A cell held by a rope, a notch or dry friction."""
    x = dice.between(0.5e-3, 3e-3)
    modules["m"] = _cell(dice, X0=x)
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
    _hear(out, "m")


def _rubbed(dice: Dice, modules: Modules) -> tuple[float, float, list[str]]:
    """A system that friction rubs: its mass [kg], the force with which it swings [N], the ends.

    A block on a belt, a displaced cell on the ground, a point of a string, or two cells.
    """
    what = dice.integer(0, 3)
    if what == 0:
        modules["m"] = _cell(dice)
        M, f = (modules["m"]["CEL"][name] for name in ("M", "f"))
        speed = dice.by_ratio(0.01, 0.5)
        modules["w"] = {"MAS": {"M": 1000.0, "V0": speed}}
        return M, M * 2.0 * np.pi * f * speed, ["w", "m"]
    if what == 1:
        x = dice.between(0.3e-3, 3e-3)
        modules["m"] = _cell(dice, X0=x)
        M, f = (modules["m"]["CEL"][name] for name in ("M", "f"))
        modules["w"] = {"SOL": {}}
        return M, M * (2.0 * np.pi * f) ** 2 * x, ["w", "m"]
    if what == 2:
        modules["m"], n = _string(dice)
        body = modules["m"]["STRING"]
        m, speed, bow = body["M"] / n, dice.by_ratio(0.02, 0.5), f"m.{dice.integer(1, n - 2)}"
        modules["w"] = {"MAS": {"M": 1000.0, "V0": speed}}
        return m, 2.0 * body["M"] * body["f"] * speed, ["w", bow]
    x = dice.between(0.3e-3, 3e-3)
    modules["m"], modules["w"] = _cell(dice, X0=x), _cell(dice)
    M, f = (modules["m"]["CEL"][name] for name in ("M", "f"))
    return M, M * (2.0 * np.pi * f) ** 2 * x, ["w", "m"]


def _dry(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Dry friction that holds and slides."""
    m, force, ends = _rubbed(dice, modules)
    F = float(force * dice.by_ratio(0.01, 2.0))
    friction = {"F": F}
    if dice.integer(0, 1):
        friction |= {"static": F * dice.between(1.0, 2.0), "speed": dice.by_ratio(0.003, 0.1)}
    is_ground = modules["w"] == {"SOL": {}}
    modules["l"] = {"DRY": ({"to": ends[1]} if is_ground else {"between": ends}) | friction}
    _strike_rubbed(dice, score, m, force, ends[1])
    _hear(out, ends[1])


def _bristle(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
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
    _hear(out, ends[1])


def _strike_rubbed(dice: Dice, score: Modules, m: float, force: float, to: str) -> None:
    """Strike at a hundredth of a second, which falls on a frame at every rate.

    Between two frames a strike on a joined mass is split evenly (docs/numerics.md).
    """
    if dice.integer(0, 1):
        impulse = min(m * dice.between(0.05, 0.5), float(force) * 1e-3)
        _strike(dice, score, f"s.{to}", impulse, dice.integer(1, 5) / 100)


def _key(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A key led by a hand, joined to a body by a spring, or striking it."""
    M, K = dice.by_ratio(0.05, 0.5), dice.by_ratio(20.0, 200.0)
    score["keys"] = {"k1": {"M": M, "K": K, "Z": dice.between(0.1, 2.0)}}
    modules["b"], n, m = _body(dice)
    target = f"b.{dice.integer(0, n - 1)}"
    peak = dice.between(2e-3, 6e-3)
    if dice.integer(0, 1):
        spring = {"K": m * dice.by_ratio(1e4, 1e7), "Z": m * dice.between(0.0, 20.0)}
        modules["c"] = {"REF": {"between": ["k1", target], **spring}}
    else:
        contact = _contact(dice, m, 0.1)
        modules["c"] = {"BUT": {"between": ["k1", target], "gap": 0.5 * peak, **contact}}
    # At hundredths of a second, which fall on frames at every rate.
    first, two = dice.integer(4, 8), dice.integer(10, 16)
    path = f"0m@0 smooth {peak}m@{first / 100}s 0m@{two / 100}s"
    score["gestures"] = {"g": {"notation": path, "touch": dice.choose("open", "tracked")}}
    score["players"] = {"p": {"key": "k1"}}
    score["parts"] = {"p": [{"at": "0.05s", "play": "g"}]}
    _hear(out, target, "k1")


def _row(dice: Dice, modules: Modules, n: int) -> tuple[float, float, float]:
    """A row of n masses on springs, or of cells that springs join; the first is displaced.

    Returns the first one's mass [kg], the stiffness that holds it [N/m], and its position [m].
    """
    M, f, x = dice.by_ratio(3e-4, 5e-3), dice.by_ratio(100.0, 600.0), dice.between(2e-4, 2e-3)
    K = M * (2.0 * np.pi * f) ** 2
    is_cells = dice.integer(0, 1)
    modules["e"] = {"SOL": {}}
    for i in range(n):
        start = {"X0": x if i == 0 else 0.0}
        if is_cells:
            tuning = {"f": f * dice.between(0.8, 2.0), "t60": dice.by_ratio(0.2, 3.0)}
            modules[f"m{i}"] = {"CEL": {"M": M * dice.between(0.3, 1.5), **tuning, **start}}
        else:
            modules[f"m{i}"] = {"MAS": {"M": M * dice.between(0.3, 1.5), **start}}
        if i or not is_cells:
            ends = [f"m{i - 1}" if i else "e", f"m{i}"]
            Z = dice.choose(0.0, dice.by_ratio(1e-4, 1e-2) * M * 2.0 * np.pi * f)
            link = {"K": float(K * dice.between(0.3, 2.0)), "Z": float(Z)}
            modules[f"r{i}"] = {"REF": {"between": ends, **link}}
    ((_, first),) = modules["m0"].items()
    return float(first["M"]), float(K), x


def _few(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """One to five masses with a single contact or law, or a mass on a spring that hits a string."""
    what = dice.choose("stop", "law", "friction", "meet", "string")
    if what == "string":
        modules["b"], n = _string(dice)
        M, speed = dice.by_ratio(5e-4, 5e-3), dice.by_ratio(0.3, 2.0)
        K = float(M * (2.0 * np.pi * dice.by_ratio(200.0, 1500.0)) ** 2)
        held = dice.choose("spring", "cell")
        if held == "cell":
            modules["h"] = {"CEL": {"M": M, "K": K, "V0": speed}}
        else:
            modules["e"] = {"SOL": {}}
            modules["h"] = {"MAS": {"M": M, "V0": speed}}
            modules["r"] = {"REF": {"between": ["e", "h"], "K": K}}
        # The hammer reaches the string: its swing is speed/omega.
        gap = dice.between(0.0, 0.5) * speed * float(np.sqrt(M / K))
        m = modules["b"]["STRING"]["M"] / n
        contact = _contact(dice, M * m / (M + m), speed)
        ends = ["h", f"b.{dice.integer(0, n - 1)}"]
        modules["c"] = {"BUT": {"between": ends, "gap": gap, **contact}}
        _hear(out, f"b.{dice.integer(0, n - 1)}")
        return
    n = dice.integer(2 if what == "meet" else 1, 5)
    m, K, x = _row(dice, modules, n)
    speed = x * float(np.sqrt(K / m))
    if what == "meet":
        # Two rows side by side: the link between the last two is a contact.
        del modules[f"r{n - 1}"]
        (kind,) = modules[f"m{n - 1}"]
        if kind == "MAS":
            ends = ["e", f"m{n - 1}"]
            modules["t"] = {"REF": {"between": ends, "K": K * dice.between(0.3, 2.0)}}
        ends, gap = [f"m{n - 2}", f"m{n - 1}"], x * dice.between(0.0, 0.3)
        modules["c"] = {"BUT": {"between": ends, "gap": gap, **_contact(dice, 0.5 * m, speed)}}
    elif what == "stop":
        modules["s"] = {"SOL": {"X0": -x * dice.between(0.0, 0.3)}}
        ends = ["s", f"m{dice.integer(0, n - 1)}"]
        modules["c"] = {"BUT": {"between": ends, **_contact(dice, m, speed)}}
    elif what == "friction":
        F = K * x * dice.by_ratio(0.01, 0.3)
        modules["d"] = {"DRY": {"to": f"m{dice.integer(0, n - 1)}", "F": F}}
    else:
        p, ratio = dice.choose(1.5, 2.0, 3.0), dice.by_ratio(0.3, 100.0)
        power = {"law": "power", "c": float(ratio * K * x ** (1.0 - p)), "p": p}
        cubic = {"law": "cubic", "damping": "cubic", "k": 0.1 * K, "q": ratio * K / x**2}
        law = dice.choose(power, cubic | {"z": dice.choose(0.0, 1e-2 * m * speed / x)})
        modules["l"] = {"LNL": {"between": ["e", "m0"], **law}}
    _hear(out, "m0", *([f"m{n - 1}"] if n > 1 else []))


def _stretch(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A plucked string whose tension rises as it is stretched, and that meets a stop or a mass."""
    modules["b"], n = _string(dice)
    body = modules["b"]["STRING"]
    m, omega = body["M"] / n, 2.0 * np.pi * body["f"]
    position, high = dice.integer(0, n - 1), dice.by_ratio(5e-4, 4e-3)
    slopes = [
        (i + 1) / (position + 1) if i <= position else (n - i) / (n - position) for i in range(n)
    ]
    body["X0"] = [{"at": i, "x": f"{high * slopes[i]!r}m"} for i in range(n)]
    # q·S over the stiffness of a link: how much the pluck raises the tension.
    k = m * omega**2 / (4.0 * np.sin(0.5 * np.pi / (n + 1)) ** 2)
    squares = high**2 * (1.0 / (position + 1) + 1.0 / (n - position))
    body["stretching"] = float(k / squares * dice.by_ratio(0.03, 2.0))
    point, speed = dice.integer(0, n - 1), omega * high
    gap = high * dice.between(0.05, 0.5)
    if dice.integer(0, 1):
        modules["o"] = dice.choose({"SOL": {}}, _cell(dice))
        contact = _contact(dice, m, speed)
        modules["c"] = {"BUT": {"between": ["o", f"b.{point}"], "gap": gap, **contact}}
    else:
        M, speed = dice.by_ratio(1e-3, 1e-2), dice.by_ratio(0.3, 3.0)
        modules["h"] = {"MAS": {"M": M, "V0": speed}}
        contact = _contact(dice, M * m / (M + m), speed)
        modules["c"] = {"BUT": {"between": ["h", f"b.{point}"], "gap": gap, **contact}}
    _hear(out, f"b.{dice.integer(0, n - 1)}")


def _rattle(dice: Dice, score: Modules, modules: Modules, out: Modules, count: int = 10) -> None:
    """Light cells that lie close to points of a body, which is struck."""
    modules["b"], n, m = _body(dice)
    ((_, body),) = modules["b"].items()
    swing = dice.by_ratio(1e-4, 1e-3)
    speed = float(2.0 * np.pi * body["f"] * swing)
    for i in range(count):
        M = m * dice.by_ratio(0.01, 0.3)
        cell = {"M": M, "f": dice.by_ratio(25.0, 400.0), "t60": dice.by_ratio(0.05, 1.0)}
        modules[f"m{i}"] = {"CEL": cell}
        contact = _contact(dice, M * m / (M + m), speed)
        ends = [f"b.{dice.integer(0, n - 1)}", f"m{i}"]
        modules[f"c{i}"] = {
            "BUT": {"between": ends, "gap": swing * dice.between(0.0, 0.5), **contact}
        }
    _strike(dice, score, f"s.b.{n // 2}", float(m * n * speed * 0.4))
    _hear(out, f"b.{dice.integer(0, n - 1)}", "m0")


def _keys(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Two to four keys, each with a contact at a point of one string; a spring may join two."""
    modules["b"], n = _string(dice)
    m = modules["b"]["STRING"]["M"] / n
    count = dice.integer(2, 4)
    points = dice.rng.choice(n, count, False)
    score |= {"keys": {}, "gestures": {}, "players": {}, "parts": {}}
    for i in range(count):
        M, K = dice.by_ratio(0.05, 0.5), dice.by_ratio(20.0, 200.0)
        score["keys"][f"k{i}"] = {"M": M, "K": K, "Z": dice.between(0.1, 3.0)}
        peak = dice.between(2e-3, 6e-3)
        contact = {"K": dice.by_ratio(200.0, 2000.0), "exponent": dice.choose(1.0, 1.5)}
        if dice.integer(0, 1):
            contact = _contact(dice, m, 0.1)
        gap = peak * dice.between(0.3, 0.8)
        ends = [f"k{i}", f"b.{points[i]}"]
        modules[f"c{i}"] = {"BUT": {"between": ends, "gap": gap, **contact}}
        # At hundredths of a second, which fall on frames at every rate.
        first = dice.integer(4, 8)
        second = first + dice.integer(4, 8)
        path = f"0m@0 smooth {peak}m@{first / 100}s 0m@{second / 100}s"
        score["gestures"][f"g{i}"] = {"notation": path, "touch": dice.choose("open", "tracked")}
        score["players"][f"p{i}"] = {"key": f"k{i}"}
        score["parts"][f"p{i}"] = [{"at": f"{dice.integer(1, 8) / 100}s", "play": f"g{i}"}]
    if dice.integer(0, 2) == 0:
        spring = {"K": dice.by_ratio(20.0, 500.0), "Z": dice.between(0.0, 1.0)}
        score["duet"] = [{"couple": ["k0", "k1"], "REF": spring}]
        # A tracked gesture on a key that a spring has moved would begin with a jump.
        for name in ("g0", "g1"):
            score["gestures"][name]["touch"] = "open"
    _hear(out, f"b.{dice.integer(0, n - 1)}", "k0")


def _rates(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A key of three masses with a rate of its own, joined to a string or striking it."""
    audio = 44100
    every = dice.choose(5, 10, 20, 42)
    score["rates"] = {"audio": f"{audio}Hz", "gesture": f"{audio // every}Hz"}
    masses = [dice.by_ratio(0.1, 0.4), dice.by_ratio(0.02, 0.08), dice.by_ratio(0.005, 0.03)]
    springs = [dice.by_ratio(20.0, 150.0), dice.by_ratio(1e3, 6e3), dice.by_ratio(1e3, 4e3)]
    names = ["ground", "key", "lever", "tip"]
    row: Modules = {"ground": {"SOL": {}}}
    for name, M in zip(names[1:], masses, strict=True):
        row[name] = {"MAS": {"M": f"{M!r}kg"}}
    for i, K in enumerate(springs):
        link = {"between": names[i : i + 2], "K": K, "Z": dice.between(0.1, 1.0)}
        row[f"r{i}"] = {"REF": link}
    score["keys"] = {"k1": {"modules": row, "struck": "key"}}
    modules["b"], n = _string(dice)
    m = modules["b"]["STRING"]["M"] / n
    peak = dice.between(2e-3, 6e-3)
    ends = ["k1.tip", f"b.{dice.integer(0, n - 1)}"]
    if dice.integer(0, 1):
        spring = {"K": dice.by_ratio(200.0, 5e3), "Z": dice.between(0.0, 0.1)}
        modules["c"] = {"REF": {"between": ends, **spring}}
    else:
        contact = _contact(dice, m, 0.1)
        modules["c"] = {"BUT": {"between": ends, "gap": 0.5 * peak, **contact}}
    # At hundredths of a second, which fall on frames at every rate.
    first, second = dice.integer(4, 8), dice.integer(10, 16)
    score["gestures"] = {"g": f"0m@0 smooth {peak}m@{first / 100}s 0m@{second / 100}s"}
    score["players"] = {"p": {"key": "k1"}}
    score["parts"] = {"p": [{"at": "0.05s", "play": "g"}]}
    _hear(out, ends[1])


FAMILIES: dict[str, Callable[[Dice, Modules, Modules, Modules], None]] = {
    "mesh": _mesh,
    "body": _damped_body,
    "linear": _linear,
    "hammer": _hammer,
    "bridge": _bridge,
    "chain": _chain,
    "bow": _bow,
    "hard": _hard,
    "law": _law,
    "dry": _dry,
    "bristle": _bristle,
    "key": _key,
    "few": _few,
    "stretch": _stretch,
    "rattle": _rattle,
    "keys": _keys,
    "rates": _rates,
}
