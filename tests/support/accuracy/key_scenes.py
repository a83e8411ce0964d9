"""Random scenes of keys that written gestures lead."""

from accuracy.dice import Dice, Modules, drawn_body, drawn_contact, drawn_string, listen_to


def key_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """A key led by a hand, joined to a body by a spring, or striking it."""
    M, K = dice.by_ratio(0.05, 0.5), dice.by_ratio(20.0, 200.0)
    score["keys"] = {"k1": {"M": M, "K": K, "Z": dice.between(0.1, 2.0)}}
    modules["b"], n, m = drawn_body(dice)
    target = f"b.{dice.integer(0, n - 1)}"
    peak = dice.between(2e-3, 6e-3)
    if dice.integer(0, 1):
        spring = {"K": m * dice.by_ratio(1e4, 1e7), "Z": m * dice.between(0.0, 20.0)}
        modules["c"] = {"REF": {"between": ["k1", target], **spring}}
    else:
        contact = drawn_contact(dice, m, 0.1)
        modules["c"] = {"BUT": {"between": ["k1", target], "gap": 0.5 * peak, **contact}}
    # At hundredths of a second, which fall on frames at every rate.
    first, two = dice.integer(4, 8), dice.integer(10, 16)
    path = f"0m@0 smooth {peak}m@{first / 100}s 0m@{two / 100}s"
    score["gestures"] = {"g": {"notation": path, "touch": dice.choose("open", "tracked")}}
    score["players"] = {"p": {"key": "k1"}}
    score["parts"] = {"p": [{"at": "0.05s", "play": "g"}]}
    listen_to(out, target, "k1")


def keys_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
    """Two to four keys, each with a contact at a point of one string; a spring may join two."""
    modules["b"], n = drawn_string(dice)
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
            contact = drawn_contact(dice, m, 0.1)
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
    listen_to(out, f"b.{dice.integer(0, n - 1)}", "k0")


def rates_scene(dice: Dice, score: Modules, modules: Modules, out: Modules) -> None:
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
    modules["b"], n = drawn_string(dice)
    m = modules["b"]["STRING"]["M"] / n
    peak = dice.between(2e-3, 6e-3)
    ends = ["k1.tip", f"b.{dice.integer(0, n - 1)}"]
    if dice.integer(0, 1):
        spring = {"K": dice.by_ratio(200.0, 5e3), "Z": dice.between(0.0, 0.1)}
        modules["c"] = {"REF": {"between": ends, **spring}}
    else:
        contact = drawn_contact(dice, m, 0.1)
        modules["c"] = {"BUT": {"between": ends, "gap": 0.5 * peak, **contact}}
    # At hundredths of a second, which fall on frames at every rate.
    first, second = dice.integer(4, 8), dice.integer(10, 16)
    score["gestures"] = {"g": f"0m@0 smooth {peak}m@{first / 100}s 0m@{second / 100}s"}
    score["players"] = {"p": {"key": "k1"}}
    score["parts"] = {"p": [{"at": "0.05s", "play": "g"}]}
    listen_to(out, ends[1])
