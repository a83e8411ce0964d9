"""`python -m benches [SCENE…]`: measure some scenes, or all of them and write docs/benchmarks.md.

`--minutes 10`: the duration of the duet, `pages`, `pointers`, `live_drums` and `soak_live`; one
minute by default. `--runs 20`: how often each stop is made, and how many keys `metrology` and
`random_keys` measure.
`--pieces bloom,workshop`: the bundled pieces that `pieces` renders. `--instruments guitar,viol`:
those of which `voices` counts the voices and that `ear` compares with recordings; `--page`: they
write docs/voices.md and docs/ear.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial

from benches import hands, reading, report
from benches.bank import bank
from benches.cluster import cluster
from benches.duet import duet
from benches.ear.scene import ear
from benches.edits import edits
from benches.enter import enter
from benches.evening import evening
from benches.first_note import first_note
from benches.gong import gong
from benches.grains import grains
from benches.growth import growth
from benches.hammer import hammer
from benches.haply import haply
from benches.interrupts import interrupts
from benches.laws import laws
from benches.live_drums import live_drums
from benches.matter import matter
from benches.measure import Row
from benches.mesh import mesh
from benches.mesh_methods import mesh_methods
from benches.metrology import metrology
from benches.mi_physics import mi_physics
from benches.midi_clock import midi_clock
from benches.native import Loops, compiler
from benches.pages import pages
from benches.part_modes import admittance, part_modes
from benches.pieces import PIECES, pieces
from benches.planning import planning
from benches.pmpd import pmpd
from benches.pointers import pointers
from benches.precision import precision
from benches.quetzalcoatl import quetzalcoatl
from benches.random_keys import random_keys
from benches.recall import recall
from benches.repl import repl
from benches.replan import replan
from benches.soak import soak, soak_live
from benches.stall import stall
from benches.stops import stops
from benches.string import string
from benches.voices import voices


def main(arguments: list[str]) -> int:
    """Run scenes; results are written to the page only if all scenes are run."""
    parser = argparse.ArgumentParser(
        "python -m benches",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--pieces", default=",".join(PIECES))
    parser.add_argument("--instruments", default="")
    parser.add_argument("--page", action="store_true")
    asked = parser.parse_args(arguments)
    wanted: list[str] = asked.scenes
    loops = Loops() if compiler() is not None else None
    networks = [bank, string, mesh, hammer, gong, precision, matter, grains]
    networks += [mi_physics, pmpd, quetzalcoatl, growth]
    scenes: dict[str, Callable[[], list[Row]]] = {
        **{scene.__name__: partial(scene, loops) for scene in networks},
        "laws": laws,
        "metrology": partial(metrology, asked.runs),
        "gesture": hands.gesture,
        "check": reading.check,
        "planning": planning,
        "part_modes": part_modes,
        "admittance": admittance,
        "start": reading.start,
        "repl": repl,
        "enter": enter,
        "evening": evening,
        "edits": edits,
        "cluster": cluster,
        "recall": recall,
        "replan": replan,
        "interrupts": interrupts,
        "duet": partial(duet, loops, asked.minutes),
        "pages": partial(pages, loops, asked.minutes),
        "pointers": partial(pointers, loops, asked.minutes),
        "first_note": first_note,
        "haply": haply,
        "soak": soak,
        "stall": stall,
        "stops": partial(stops, asked.runs),
        "live_drums": partial(live_drums, asked.minutes),
    }
    # Each takes minutes, so it runs only if it is named.
    if "mesh_methods" in wanted:
        scenes["mesh_methods"] = mesh_methods
    if "pieces" in wanted:
        scenes["pieces"] = partial(pieces, asked.pieces.split(","))
    if "voices" in wanted:
        names = [name for name in asked.instruments.split(",") if name]
        scenes["voices"] = partial(voices, names, asked.page)
    if "ear" in wanted:
        names = [name for name in asked.instruments.split(",") if name]
        scenes["ear"] = partial(ear, names, asked.page)
    if "random_keys" in wanted:
        scenes["random_keys"] = partial(random_keys, asked.runs)
    if "soak_live" in wanted:
        scenes["soak_live"] = partial(soak_live, asked.minutes)
    if "midi_clock" in wanted:
        scenes["midi_clock"] = partial(midi_clock, asked.minutes)
    if unknown := [name for name in wanted if name not in scenes]:
        print(f"no scene {unknown[0]}; there are {', '.join(scenes)}", file=sys.stderr)
        return 2
    built_on = report.machine()
    rows: list[Row] = []
    for name in wanted or scenes:
        for row in scenes[name]():
            rows.append(row)
            ratio = "" if row.ratio is None else f"  {row.ratio:.2f} {row.sense}"
            print(f"{row.scene}: {row.ours}  [{row.reference}]{ratio}", flush=True)
    if not wanted:
        report.write(rows, built_on)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
