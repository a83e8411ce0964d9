"""Random scenes of masses and strings that meet something."""

import numpy as np

from accuracy.dice import (
    Dice,
    Modules,
    add_strike,
    drawn_body,
    drawn_cell,
    drawn_contact,
    drawn_string,
    listen_to,
)


def hammer_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A mass that flies against a cell or a body."""
    if dice.integer(0, 1):
        modules["t"] = drawn_cell(dice)
        target, m = "t", modules["t"]["CEL"]["M"]
    else:
        modules["t"], n, m = drawn_body(dice)
        target = f"t.{dice.integer(0, n - 1)}"
    M, speed = dice.by_ratio(2e-3, 2e-2), dice.by_ratio(0.3, 4.0)
    modules["h"] = {"MAS": {"M": M, "V0": speed}}
    contact = drawn_contact(dice, M * m / (M + m), speed)
    gap = dice.between(1e-4, 2e-3)
    modules["c"] = {"BUT": {"between": ["h", target], "gap": gap, **contact}}
    listen_to(out, target)


def bridge_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A string over a curved obstacle, which holds still or is a cell: contacts at many points."""
    n = dice.integer(24, 72)
    f, M = dice.by_ratio(40.0, min(400.0, 12000.0 / n)), dice.by_ratio(1e-3, 2e-2)
    body = {"masses": n, "M": M, "f": f, "t60": dice.by_ratio(1.0, 8.0)}
    modules["b"] = {"STRING": body}
    modules["o"] = dice.choose({"SOL": {}}, drawn_cell(dice))
    first, points = dice.integer(0, n // 3), dice.integer(2, n // 2)
    swing = dice.by_ratio(1e-4, 2e-3)
    speed = 2.0 * np.pi * f * swing
    far = swing * (first + points) / n  # about how far the string swings where the obstacle ends
    profile = {"depth": f"{far * dice.by_ratio(0.02, 0.5)!r}m", "power": dice.choose(1.0, 2.0)}
    if dice.integer(0, 1):
        profile["least"] = f"{far * dice.between(0.0, 0.1)!r}m"
    contact = drawn_contact(dice, M / n, speed)
    ends = ["o", f"b.{first}..{first + points - 1}"]
    modules["c"] = {"BUT": {"between": ends, "gap": profile, **contact}}
    add_strike(dice, score, f"s.b.{dice.integer(n // 2, n - 1)}", M * speed)
    listen_to(out, f"b.{dice.integer(n // 2, n - 1)}")


def chain_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Cells in a row that hit one another."""
    n = dice.integer(3, 6)
    for i in range(n):
        modules[f"m{i}"] = drawn_cell(dice, V0=dice.between(0.3, 2.0) if i == 0 else 0.0)
    for i in range(1, n):
        a, b = (modules[f"m{j}"]["CEL"]["M"] for j in (i - 1, i))
        contact = drawn_contact(dice, a * b / (a + b), 0.5)
        gap = dice.between(1e-5, 3e-4)
        modules[f"c{i}"] = {"BUT": {"between": [f"m{i - 1}", f"m{i}"], "gap": gap, **contact}}
    listen_to(out, *(f"m{i}" for i in range(n)))


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


def few_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """One to five masses with a single contact or law, or a mass on a spring that hits a string."""
    what = dice.choose("stop", "law", "friction", "meet", "string")
    if what == "string":
        modules["b"], n = drawn_string(dice)
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
        contact = drawn_contact(dice, M * m / (M + m), speed)
        ends = ["h", f"b.{dice.integer(0, n - 1)}"]
        modules["c"] = {"BUT": {"between": ends, "gap": gap, **contact}}
        listen_to(out, f"b.{dice.integer(0, n - 1)}")
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
        modules["c"] = {"BUT": {"between": ends, "gap": gap, **drawn_contact(dice, 0.5 * m, speed)}}
    elif what == "stop":
        modules["s"] = {"SOL": {"X0": -x * dice.between(0.0, 0.3)}}
        ends = ["s", f"m{dice.integer(0, n - 1)}"]
        modules["c"] = {"BUT": {"between": ends, **drawn_contact(dice, m, speed)}}
    elif what == "friction":
        F = K * x * dice.by_ratio(0.01, 0.3)
        modules["d"] = {"DRY": {"to": f"m{dice.integer(0, n - 1)}", "F": F}}
    else:
        p, ratio = dice.choose(1.5, 2.0, 3.0), dice.by_ratio(0.3, 100.0)
        power = {"law": "power", "c": float(ratio * K * x ** (1.0 - p)), "p": p}
        cubic = {"law": "cubic", "damping": "cubic", "k": 0.1 * K, "q": ratio * K / x**2}
        law = dice.choose(power, cubic | {"z": dice.choose(0.0, 1e-2 * m * speed / x)})
        modules["l"] = {"LNL": {"between": ["e", "m0"], **law}}
    listen_to(out, "m0", *([f"m{n - 1}"] if n > 1 else []))


def stretch_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A plucked string whose tension rises as it is stretched, and that meets a stop or a mass."""
    modules["b"], n = drawn_string(dice)
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
        modules["o"] = dice.choose({"SOL": {}}, drawn_cell(dice))
        contact = drawn_contact(dice, m, speed)
        modules["c"] = {"BUT": {"between": ["o", f"b.{point}"], "gap": gap, **contact}}
    else:
        M, speed = dice.by_ratio(1e-3, 1e-2), dice.by_ratio(0.3, 3.0)
        modules["h"] = {"MAS": {"M": M, "V0": speed}}
        contact = drawn_contact(dice, M * m / (M + m), speed)
        modules["c"] = {"BUT": {"between": ["h", f"b.{point}"], "gap": gap, **contact}}
    listen_to(out, f"b.{dice.integer(0, n - 1)}")


def rattle_scene(
    dice: Dice, score: Modules, modules: Modules, out: Modules, count: int = 10
) -> None:
    """Light cells that lie close to points of a body, which is struck."""
    modules["b"], n, m = drawn_body(dice)
    ((_, body),) = modules["b"].items()
    swing = dice.by_ratio(1e-4, 1e-3)
    speed = float(2.0 * np.pi * body["f"] * swing)
    for i in range(count):
        M = m * dice.by_ratio(0.01, 0.3)
        cell = {"M": M, "f": dice.by_ratio(25.0, 400.0), "t60": dice.by_ratio(0.05, 1.0)}
        modules[f"m{i}"] = {"CEL": cell}
        contact = drawn_contact(dice, M * m / (M + m), speed)
        ends = [f"b.{dice.integer(0, n - 1)}", f"m{i}"]
        modules[f"c{i}"] = {
            "BUT": {"between": ends, "gap": swing * dice.between(0.0, 0.5), **contact}
        }
    add_strike(dice, score, f"s.b.{n // 2}", float(m * n * speed * 0.4))
    listen_to(out, f"b.{dice.integer(0, n - 1)}", "m0")
