"""The stream of ergons as text: a versioned header, then a row an ergon, CSV or JSON lines."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from ergon.common.terminal import json_text

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Ergons = Mapping[str, NDArray[np.float64]]  # columns of _core.Simulation.ergons()

VERSION = 1
Form = Literal["csv", "json"]
COLUMNS = (
    "time [s]",
    "struck",
    "sign",
    "mass [kg]",
    "speed [m/s]",
    "impulse [N·s]",
    "source",
)
_KEYS = ("time_s", "struck", "sign", "mass_kg", "speed_m_s", "impulse_n_s", "source")


@dataclass(frozen=True, slots=True)
class Names:
    """Names for the numbers of the engine: a MAT index or a source number to text.

    `reach` gives the lever ratio of a struck key by name: the engine computes a key behind a
    lever as the piece sees it, `reach` times as far.
    """

    struck: Callable[[int], str]
    source: Callable[[int], str]
    reach: Callable[[str], float] = lambda _: 1.0


def header(form: Form, *, title: str, rate: float, score: str) -> str:
    """The first lines of a stream."""
    if form == "json":
        about = {
            "v": VERSION,
            "event": "stream",
            "by": "made by ergon",
            "title": title,
            "rate_hz": rate,
            "score": score,
        }
        return json_text(about) + "\n"
    facts = ["made by ergon", f"{rate:g} Hz", f"score {score}", " ".join(title.split())]
    rows = io.StringIO()
    csv.writer(rows, lineterminator="\n").writerow(COLUMNS)
    return f"# ergon stream {VERSION}, {', '.join(filter(None, facts))}\n" + rows.getvalue()


def rows(form: Form, ergons: Ergons, names: Names) -> str:
    """Rows of one block; numbers are the shortest decimals that read back to the same bits."""
    body = io.StringIO()
    if form == "json":
        for row in _rows(ergons, names):
            body.write(json_text(dict(zip(_KEYS, row, strict=True))) + "\n")
    else:
        csv.writer(body, lineterminator="\n").writerows(_rows(ergons, names))
    return body.getvalue()


def _rows(ergons: Ergons, names: Names) -> Iterator[Sequence[object]]:
    struck: dict[int, tuple[str, float]] = {}
    source: dict[int, str] = {}
    columns = ("time", "mat", "mass", "speed", "impulse", "source")
    lists = [ergons[column].tolist() for column in columns]
    for time, mat, mass, speed, impulse, place in zip(*lists, strict=True):
        if mat not in struck:
            name = names.struck(int(mat))
            struck[mat] = name, names.reach(name)
        if place not in source:
            source[place] = names.source(int(place))
        # As in the paper, the sign has a column of its own: the direction in which the ergon
        # strikes.
        sign = "-" if impulse < 0 else "+"
        name, reach = struck[mat]
        mass, speed, impulse = mass * reach * reach, abs(speed) / reach, abs(impulse) * reach
        yield time, name, sign, mass, speed, impulse, source[place]
