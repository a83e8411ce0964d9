"""`python -m benches [SCENE…]`: measure all scenes, or some, and write docs/benchmarks.md."""

from __future__ import annotations

import sys
from collections.abc import Callable

from benches import hands, networks, reading, report
from benches.measure import Row
from benches.native import Loops, compiler


def main(wanted: list[str]) -> int:
    """Run scenes; only a run of all of them is written down."""
    loops = Loops() if compiler() is not None else None
    scenes: dict[str, Callable[[], list[Row]]] = {
        "bank": lambda: networks.bank(loops),
        "gong": lambda: networks.gong(loops),
        "string": lambda: networks.string(loops),
        "gesture": hands.gesture,
        "check": reading.check,
        "start": reading.start,
    }
    if unknown := [name for name in wanted if name not in scenes]:
        print(f"no scene {unknown[0]}; there are {', '.join(scenes)}", file=sys.stderr)
        return 2
    made_on = report.machine()
    rows: list[Row] = []
    for name in wanted or scenes:
        for row in scenes[name]():
            rows.append(row)
            ratio = "" if row.ratio is None else f"  {row.ratio:.2f} {row.sense}"
            print(f"{row.scene}: {row.ours}  [{row.reference}]{ratio}", flush=True)
    if not wanted:
        report.write(rows, made_on)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
