"""The table of voices, and the page that shows it."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

PAGE = Path(__file__).parent.parent / "docs" / "voices.md"
_HEAD = """\
# Voices in real time

How many voices of each instrument that ships does one core play at once? `python -m benches voices`
prints this table and `--page` writes this page anew. `--instruments guitar,viol`
measures some.

* Machine: {cpu}, {cores} cores, {system}; Python {python}; {peers}; load before the run {load}.
  One core was used. All took turns in one run: only ratios travel to other machines.
* A figure is voices times seconds of sound over the processor time that they took, least of
  {rounds} rounds. Reading, planning, start, loading and compilation do not count.
* Every voice is struck twice a second, all at the same instant, or rubbed without a pause: as
  [its card](instruments/README.md) says, in the middle strength. The second and third second of it
  count. *Voices* is the mean over both. *When struck* is how many get through the busiest tenth of
  a second in real time: contacts cost most while they are closed. Voices that are struck one after
  another lie between.
* ergon: one score of one to eight voices, planned by ear as `ergon render` does, one thread, blocks
  of 256 frames; the mix with its high-pass counts. *Modules* are MATs and LIAs of a voice, its bow
  included. *Computed* says [how](numerics.md), with modules; `× 2` is two steps a frame. What some
  of the voices do otherwise stands behind a semicolon. A part that has fallen by 90 dB sleeps until
  its next stroke.
* Csound: in double precision, `ksmps` 256, without a sound card; the difference of 4 s and 1 s of
  sound. `mode × 5` is a voice of five `mode`, as many as the instrument has oscillators; an
  impulse excites them, where a mallet touches ergon's. `prepiano` has two strings.
* Faust: models of its `physmodels.lib` (`pm`) in double precision, compiled with
  `-O3 -march=native`, an instance for each voice. Pitches are constants there, which makes a voice
  cheaper than one that a slider tunes.
* Models beside an instrument are of its kind, not of its size or exactness: `pluck` is a delay line
  and a filter; `guitar` is a string of 60 masses on a box of three. A dash: there is none of the
  kind.

"""
_COLUMNS = ("instrument", "modules", "computed", "voices", "when struck", "Csound", "Faust")


class PlanRow(Protocol):
    """What the table tells of a part of a plan."""

    parts: list[str]
    n_mat: int
    n_lia: int
    oversampling: int

    @property
    def what(self) -> str:
        """How the part is computed."""


@dataclass(frozen=True, slots=True)
class Line:
    """An instrument: modules of a voice, how they are computed, how many voices one core plays on
    average and in the busiest tenth of a second, and models of the same kind for each program.
    """

    file: str
    name: str
    modules: int
    method: str
    voices: float
    busiest: float
    references: Mapping[str, Sequence[str]]


def method(rows: Iterable[PlanRow]) -> str:
    """How each voice is computed, with modules; what few voices do after what most do."""
    voices: dict[str, list[str]] = defaultdict(list)
    for row in rows:
        if row.what in ("still", "unheard"):
            continue
        voice = next((part for part in row.parts if part[0] == "v"), "").partition(".")[0]
        steps = f" × {row.oversampling}" if row.oversampling > 1 else ""
        voices[voice].append(f"{row.what} {row.n_mat + row.n_lia:,}{steps}")
    counts = Counter(" + ".join(parts) for parts in voices.values())
    return "; ".join(what for what, _ in counts.most_common())


def number(voices: float) -> str:
    """Two digits, which is what such a measurement is worth."""
    return f"{float(f'{voices:.2g}'):,.{0 if voices >= 9.95 else 1}f}"


def table(lines: Sequence[Line], counts: Mapping[str, float], missing: Mapping[str, str]) -> str:
    """A row for each instrument; a program that is missing has the reason in its column."""
    rows = [f"| {' | '.join(_COLUMNS)} |", f"|{'---|' * len(_COLUMNS)}"]
    for line in lines:
        cells = [f"`{line.name}`", f"{line.modules:,}", line.method]
        cells += [f"**{number(line.voices)}**", number(line.busiest)]
        for program in ("Csound", "Faust"):
            models = line.references[program]
            reasons = {missing[model] for model in models if model in missing}
            measured = [f"`{m}` {number(counts[m])}" for m in models if m in counts]
            cells.append("; ".join([*measured, *sorted(reasons)]) or "–")
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def write(text: str, machine: Mapping[str, str | int | float], rounds: int) -> None:
    """Write the page."""
    load = f"{machine['load_before']:.1f}"
    PAGE.write_text(_HEAD.format(**machine, load=load, rounds=rounds) + text, encoding="utf-8")
