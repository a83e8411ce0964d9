"""The command line: the time it takes to start, and to check long scores."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from benches import scores
from benches.measure import Row, commands

ROUNDS = 5
_COMPOSE = """
import sys, yaml
yaml.compose(open(sys.argv[1]).read(), getattr(yaml, "CSafeLoader", yaml.SafeLoader))
"""
# scene, text, target [s of wall time on an idle machine]
_SCENES = (
    ("check 10,000 YAML entries", lambda: scores.entries(10_000), 1.0),
    ("check a gesture of 100,000 rows", lambda: scores.points(100_000), 2.0),
    ("check a part of 100,000 rows", lambda: scores.rows(100_000), 2.0),
    ("check 100,000 repetitions", lambda: scores.times(100_000), 2.0),
    ("check 200,000 strikes", lambda: scores.strikes(100_000), 2.0),
)
_ERGON = [sys.executable, "-m", "ergon.cli"]
_NOTHING = [sys.executable, "-c", "pass"]


def start() -> list[Row]:
    """`ergon --help`, with its files in the cache."""
    spent = commands(15, {"ours": [*_ERGON, "--help"], "nothing": _NOTHING})
    ours, nothing = spent["ours"], spent["nothing"]
    values = {"wall_s": ours.wall, "cpu_s": ours.cpu, "memory_mb": ours.memory, "target_s": 0.1}
    return [
        Row(
            "`ergon --help`, warm (target 0.1 s)",
            f"{1e3 * ours.wall:.0f} ms, of processor {1e3 * ours.cpu:.0f} ms",
            f"`python -c pass`: {1e3 * nothing.wall:.0f} ms, {1e3 * nothing.cpu:.0f} ms",
            ours.cpu / nothing.cpu,
            "processor time over the reference's",
            values,
        )
    ]


def check() -> list[Row]:
    """`ergon check` of long scores, compared with composing the same text and with doing
    nothing.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for scene, text, target in _SCENES:
            path = Path(folder) / "score.yaml"
            path.write_text(text())
            lines = {
                "ours": [*_ERGON, "check", "-q", str(path)],
                "compose": [sys.executable, "-c", _COMPOSE, str(path)],
                "nothing": _NOTHING,
            }
            spent = commands(ROUNDS, lines)
            ours, compose, nothing = spent["ours"], spent["compose"], spent["nothing"]
            rows.append(
                Row(
                    f"{scene} (target {target:g} s)",
                    f"{ours.wall:.2f} s, of processor {ours.cpu:.2f} s; {ours.memory:.0f} MB",
                    f"yaml.compose: {compose.cpu:.2f} s, {compose.memory:.0f} MB; "
                    f"`python -c pass`: {nothing.cpu:.2f} s, {nothing.memory:.0f} MB",
                    ours.cpu / compose.cpu,
                    "processor time over yaml.compose's",
                    {
                        "wall_s": ours.wall,
                        "cpu_s": ours.cpu,
                        "memory_mb": ours.memory,
                        "target_s": target,
                        "bytes": path.stat().st_size,
                        "compose_cpu_s": compose.cpu,
                        "compose_memory_mb": compose.memory,
                        "nothing_cpu_s": nothing.cpu,
                        "nothing_memory_mb": nothing.memory,
                    },
                )
            )
    return rows
