"""The page docs/ear.md: verdicts as tables, before and now, beside what is recorded."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benches.ear.features import FEATURES, NAMES, OCTAVES
from benches.ear.recorded import Recorded
from benches.ear.verdict import Verdict
from docs.generators.wrap import wrapped

PAGE = Path(__file__).parents[2] / "docs" / "ear.md"
BEFORE = Path(__file__).with_name("before.csv")
_HEAD = """\
# How near to recordings

`make ear` plays each instrument that is meant to sound like a known one soft, middle and hard, as
[its card](instruments/README.md) says, measures 76 figures of each sound (attack, spectrum, bands,
noise, partials, decay, motion), and compares them with the same figures of 1,390 recorded notes and
strokes. `python -m benches ear --instruments piano,snare` prints some and writes nothing. Do not
edit this page.

* *Taken for* is the class, out of {n_classes}, that linear discriminants choose; *rank* is the
  place of the right one among them. Of recordings whose source was not learnt from {first:.0%} are
  put first and {third:.0%} among the first three.
* *Distance* is from the mean of the recordings near the same pitch, in their standard deviations:
  the root mean square over seven groups of figures. Distances are of figures, not of listeners.
* In brackets is the distance within which 95 % of the recordings lie, and *another source*: how far
  the recordings of each source lie, in the median, from the mean of the others, in standard
  deviations of those (the nearest and the farthest of the sources). Only of {several}
  there are three recordings of a source and six of others near the pitch. All others are of FluidR3
  alone, the tabla of Sonic Pi: these have a dash and are judged by the 95 %, which is stricter, as
  one hand played and one room answered.
* *Cost* is what the plan of one voice states, as a share of a core of the reference machine.
* Recorded were FluidR3 GM (MIT), the Salamander grand piano (CC BY), AVL Drumkits and the samples
  of Sonic Pi. Rooms and loops are in them: what a hall does to a drum is no aim for a skin.

{right} of {n} are taken for what they are, {among} are among the first three; on 28 November 2026,
before they were worked at by this table, {right_before} and {among_before} of {n_before}. What is
newer has a dash.

{within} of the older {n_older} are within what one source is from the others: {within_several} of
the {n_several} that have several sources, and {within_one} of the {n_one} that have one lie within
95 % of its recordings.

"""


def _number(value: float) -> str:
    return "–" if not math.isfinite(value) else f"{value:.3g}"


def _three(values: Sequence[float], form: str = ".0f") -> str:
    return " / ".join(format(v, form) if math.isfinite(v) else "–" for v in values)


def extent(values: Sequence[float]) -> str:
    """From the least to the greatest, once if they are alike, a dash if there is none."""
    ends = [f"{end(values):.2f}" for end in (min, max) if values]
    return "–".join(dict.fromkeys(ends)) or "–"


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), *words[-1:]] if len(words) > 1 else words)


def before() -> dict[str, dict[str, str]]:
    """The verdicts of the first run: rank, distance and cost of each instrument."""
    with BEFORE.open(encoding="utf-8") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def verdicts_table(verdicts: Sequence[Verdict]) -> str:
    """A row for each instrument, now and before."""
    rows = [
        "| instrument | class | taken for | rank (before) | "
        "distance (before) [95 %; another source] | cost (before) | most off |",
        f"|{'---|' * 7}",
    ]
    earlier = before()
    for v in sorted(verdicts, key=lambda v: -v.distance):
        rank, distance, cost = "–", "–", "–"
        if (old := earlier.get(v.name)) is not None:
            rank, distance, cost = (
                old["rank"],
                f"{float(old['distance']):.2f}",
                f"{float(old['cost']):.2%}",
            )
        limits = f"{v.distance_95:.2f}; {extent(v.distances_of_sources)}"
        rows.append(
            f"| `{v.name}` | {v.wanted} | {v.taken_for} | {v.rank} ({rank}) | "
            f"{v.distance:.2f} ({distance}) [{limits}] | "
            f"{v.cost:.2%} ({cost}) | {'; '.join(v.off)} |"
        )
    return "\n".join(rows) + "\n"


def strengths_table(verdicts: Sequence[Verdict]) -> str:
    """How each instrument follows the hand."""
    rows = [
        "| instrument | loudest 400 ms [LUFS] | soft to hard [LU] | centre of 0-50 ms [Hz] |"
        " centre of 0-0.5 s [Hz] |",
        f"|{'---|' * 5}",
    ]
    for v in verdicts:
        rows.append(
            f"| `{v.name}` | {_three(v.levels, '.1f')} | {v.levels[2] - v.levels[0]:.1f} | "
            f"{_three(v.column('a_cent'))} | {_three(v.column('b_cent'))} |"
        )
    return "\n".join(rows) + "\n"


def decays_table(recorded: Recorded, verdicts: Sequence[Verdict], pitches: dict[str, float]) -> str:
    """T60 of each octave at the middle stroke, beside what is recorded."""
    heads = [f"{f} Hz" for f in OCTAVES[1:8]]
    rows = [f"| instrument | {' | '.join(heads)} |", f"|{'---|' * 8}"]
    for v in verdicts:
        kin = recorded.kin(v.wanted, pitches.get(v.name))
        cells = []
        for f in OCTAVES[1:8]:
            name = f"t60_{f}"
            recordings = recorded.figures[kin.rows, NAMES.index(name)]
            recordings = recordings[np.isfinite(recordings)]
            spread = "–"
            if len(recordings) > 3:
                tenths = np.percentile(recordings, (10, 50, 90))
                spread = "…".join(_number(FEATURES[name].plain(float(t))) for t in tenths)
            cells.append(f"{_number(v.column(name)[1])} ({spread})")
        rows.append(f"| `{v.name}` | {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def text(recorded: Recorded, verdicts: Sequence[Verdict], pitches: dict[str, float]) -> str:
    """The page."""
    ranks = [rank for each in recorded.ranks_without_source().values() for rank in each]
    verdicts_before = before()
    older = [v for v in verdicts if v.name in verdicts_before]
    several = [v for v in older if v.distances_of_sources]
    single = [v for v in older if not v.distances_of_sources]
    earlier = [int(verdicts_before[v.name]["rank"]) for v in verdicts if v.name in verdicts_before]
    head = _HEAD.format(
        n_classes=len(recorded.learnt.classes),
        first=np.mean([rank == 1 for rank in ranks]),
        third=np.mean([rank <= 3 for rank in ranks]),
        n=len(verdicts),
        right=sum(v.rank == 1 for v in verdicts),
        among=sum(v.rank <= 3 for v in verdicts),
        right_before=sum(rank == 1 for rank in earlier),
        among_before=sum(rank <= 3 for rank in earlier),
        n_before=len(earlier),
        several=_listed(sorted({v.wanted for v in several})),
        within=sum(v.within for v in older),
        n_older=len(older),
        within_several=sum(v.within for v in several),
        n_several=len(several),
        within_one=sum(v.within for v in single),
        n_one=len(single),
    )
    parts = [
        head + verdicts_table(verdicts),
        "## By strength\n\nSoft / middle / hard. Recorded pianos span 13 to 17 dB, drums 21 to 33."
        "\n\n" + strengths_table(verdicts),
        "## T60 of octaves [s]\n\nThe middle stroke, and the 10th, 50th and 90th percentile that "
        "are recorded.\n\n" + decays_table(recorded, verdicts, pitches),
    ]
    return wrapped("\n".join(parts))
