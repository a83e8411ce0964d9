"""How long `check` takes for random scenes: reading, planning and staging, in CPU time."""

from __future__ import annotations

import os
import random
import resource
import statistics
import sys
from dataclasses import dataclass

from benches.measure import Row

# Accuracies that a score may ask for; a cost that no plan can keep makes looser plans too.
ACCURACIES = (
    "{error: -40dB}",
    "{error: -60dB, cpu: 0.0001%}",
    "{error: -100dB}",
    "{error: -150dB}",
    "{error: -150dB, cpu: 0.0001%}",
)
# Numbers of modules, and the greatest CPU time allowed for a `check` [s].
SIZES = ((100, 2.0), (1_000, 10.0))
PATIENCE = 120  # CPU time of a check [s]
_LAWS = """\
laws:
  cubic: {law: k*d + q*d**3, k: 200N/m, q: 4e7N/m3}
  bow: {damping: f*v*exp(-(v/w)**2), f: 0.4N, w: 0.1m/s}
"""


class _Scene:
    """Random bodies, joined by links of every kind; keys that play them."""

    def __init__(self, chance: random.Random, n_modules: int) -> None:
        self.chance = chance
        self.lines: list[str] = []
        self.ends: list[str] = []
        self.keys = [f"k{i}" for i in range(chance.choice((1, 2, 4)))]
        left = n_modules
        while left > 0:
            left -= self._body(f"m{len(self.lines)}", left)
            for _ in range(chance.randint(0, 2)):
                left -= self._link(chance.choice(self.ends), chance.choice(self.ends))
        for key in self.keys:
            self._link(key, chance.choice(self.ends), is_contact=chance.random() < 0.7)

    def _between(self, low: float, high: float) -> str:
        return f"{low * (high / low) ** self.chance.random():.4g}"

    def _body(self, name: str, left: int) -> int:
        """Add a body of at most `left` modules; returns its number of modules."""
        chance = self.chance
        mass = f"M: {self._between(1e-3, 0.3)}kg"
        pitch = f"f: {self._between(60, 900)}Hz, t60: {self._between(0.2, 4)}s"
        hard = f", hardening: {self._between(1e4, 1e9)}N/m3" if chance.random() < 0.2 else ""
        kind = chance.choice(("CEL", "STRING", "STRING", "PLATE", "BANK"))
        size, ends = 1, [name]
        if kind == "STRING" and left > 8:
            n_masses = chance.randint(3, min(200, left // 2))
            what = f"masses: {n_masses}, {mass}, {pitch}{hard}"
            size, ends = 2 * n_masses, [f"{name}.1", f"{name}.2"]
        elif kind == "PLATE" and left > 40:
            radius = chance.randint(1, min(8, int((left / 12) ** 0.5)))
            what = f"shape: hex, radius: {radius}, {mass}, {pitch}{hard}"
            size, ends = 12 * radius * (radius + 1) + 1, [f"{name}.centre", f"{name}.0"]
        elif kind == "BANK":
            size = chance.randint(1, min(60, left))
            what = f"count: {size}, {mass}, f: 80Hz..3kHz, t60: 0.2s..3s"
            ends = [f"{name}.{size - 1}"]
        else:
            kind, what = "CEL", f"{mass}, {pitch}"
        self.lines.append(f"{name}: {{{kind}: {{{what}}}}}")
        self.ends += ends
        return size

    def _link(self, a: str, b: str, *, is_contact: bool = False) -> int:
        if a == b:
            return 0
        stiff, damp = f"K: {self._between(1, 1e4)}N/m", f"Z: {self._between(1e-3, 1)}Ns/m"
        kinds = {
            "REF": f"{stiff}, {damp}",
            "BUT": f"gap: {self.chance.choice(('0mm', '0.2mm'))}, {stiff}, {damp}",
            "LNL": self.chance.choice(("law: cubic", "damping: bow")),
        }
        kind = "BUT" if is_contact else self.chance.choice(tuple(kinds))
        name = f"l{len(self.lines)}"
        self.lines.append(f"{name}: {{{kind}: {{between: [{a}, {b}], {kinds[kind]}}}}}")
        return 1


def scene(seed: int, n_modules: int) -> str:
    """A score of about so many modules."""
    chance = random.Random(f"planning {seed} {n_modules}")
    built = _Scene(chance, n_modules)
    listened = ", ".join(f"o{i}: {{SOX: {end}}}" for i, end in enumerate(built.ends[:4]))
    modules = "\n".join(f"      {line}" for line in built.lines)
    return (
        "ergon: 1\n"
        f"keys: {{{', '.join(f'{key}: {{M: 300g, K: 60N/m, Z: 1Ns/m}}' for key in built.keys)}}}\n"
        f"{_LAWS}instruments:\n  thing:\n    modules:\n{modules}\n    out: {{{listened}}}\n"
        "gestures: {go: 0mm@0 smooth 4mm@40ms throw 0mm@90ms}\n"
        f"players: {{{', '.join(f'p{key}: {{key: {key}}}' for key in built.keys)}}}\n"
        f"parts: {{{', '.join(f'p{key}: [{{at: 1|1, play: go}}]' for key in built.keys)}}}\n"
        "render: {tail: 1s}\n"
        f"accuracy: {chance.choice(ACCURACIES)}\n"
    )


@dataclass(frozen=True, slots=True)
class Checked:
    """A `check` in its own process: its exit code, -9 after PATIENCE; CPU time [s]."""

    seed: int
    code: int
    seconds: float


def checked(seed: int, n_modules: int) -> Checked:
    """Check a scene in a forked process, so that nothing is cached from another scene."""
    text = scene(seed, n_modules)
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE))
        os.environ["ERGON_CACHE"] = "off"
        code = 70
        try:
            code = _run(text)
        finally:
            os._exit(code)
    _, status, used = os.wait4(child, 0)
    return Checked(seed, os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime)


def _run(text: str) -> int:
    import contextlib
    import io

    from ergon.cli.app import run

    sys.stdin = io.TextIOWrapper(io.BytesIO(text.encode()))
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return run(["check", "-"])


def planning(count: int = 40) -> list[Row]:
    """`count` scenes of each size."""
    import ergon.cli.check  # noqa: F401  # its import is no part of planning

    rows = []
    for n_modules, limit in SIZES:
        all_checked = [checked(seed, n_modules) for seed in range(count)]
        sound = [one for one in all_checked if one.code == 0]
        seconds = sorted(one.seconds for one in all_checked)
        worst = max(all_checked, key=lambda one: one.seconds)
        n_long = sum(one.seconds > limit for one in all_checked)
        text = (
            f"CPU time: median {statistics.median(seconds):.2f} s, "
            f"slowest {worst.seconds:.2f} s (scene {worst.seed}); {n_long} above {limit:g} s; "
            f"{len(sound)} of {count} accepted"
        )
        values: dict[str, float | int | str] = {
            "median_s": statistics.median(seconds),
            "slowest_s": worst.seconds,
            "above": n_long,
        }
        what = f"`check` of a scene by chance, about {n_modules:,} modules"
        target = f"target: at most {limit:g} s of one core"
        rows.append(Row(what, text, target, None, "by CPU time", values))
    return rows
