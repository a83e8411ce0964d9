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

STREAM_VERSION = 1
Form = Literal["csv", "json"]
COLUMN_NAMES = (
    "time [s]",
    "struck",
    "sign",
    "mass [kg]",
    "speed [m/s]",
    "impulse [N·s]",
    "source",
)
_JSON_KEYS = ("time_s", "struck", "sign", "mass_kg", "speed_m_s", "impulse_n_s", "source")


@dataclass(frozen=True, slots=True)
class ErgonNames:
    """Names for the numbers of the engine: a MAT index or a source number to text.

    `lever_ratio` gives the lever ratio of a struck key by name: the engine computes a key behind a
    lever as the piece sees it, `lever_ratio` times as far.
    """

    struck_name: Callable[[int], str]
    source_name: Callable[[int], str]
    lever_ratio: Callable[[str], float] = lambda _: 1.0


def stream_header(form: Form, *, title: str, rate: float, score: str) -> str:
    """The first lines of a stream."""
    if form == "json":
        header_fields = {
            "v": STREAM_VERSION,
            "event": "stream",
            "by": "made by ergon",
            "title": title,
            "rate_hz": rate,
            "score": score,
        }
        return json_text(header_fields) + "\n"
    facts = ["made by ergon", f"{rate:g} Hz", f"score {score}", " ".join(title.split())]
    rows = io.StringIO()
    csv.writer(rows, lineterminator="\n").writerow(COLUMN_NAMES)
    return f"# ergon stream {STREAM_VERSION}, {', '.join(filter(None, facts))}\n" + rows.getvalue()


def stream_rows(row_form: Form, ergons: Ergons, ergon_names: ErgonNames) -> str:
    """Rows of one block; numbers are the shortest decimals that read back to the same bits."""
    row_buffer = io.StringIO()
    if row_form == "json":
        for row in _ergon_rows(ergons, ergon_names):
            row_buffer.write(json_text(dict(zip(_JSON_KEYS, row, strict=True))) + "\n")
    else:
        csv.writer(row_buffer, lineterminator="\n").writerows(_ergon_rows(ergons, ergon_names))
    return row_buffer.getvalue()


def _ergon_rows(ergons: Ergons, ergon_names: ErgonNames) -> Iterator[Sequence[object]]:
    struck_by_mat: dict[int, tuple[str, float]] = {}
    source_by_number: dict[int, str] = {}
    columns = ("time", "mat", "mass", "speed", "impulse", "source")
    column_lists = [ergons[column].tolist() for column in columns]
    for time, mat, struck_mass, speed, impulse, source_number in zip(*column_lists, strict=True):
        if mat not in struck_by_mat:
            struck_name = ergon_names.struck_name(int(mat))
            struck_by_mat[mat] = struck_name, ergon_names.lever_ratio(struck_name)
        if source_number not in source_by_number:
            source_by_number[source_number] = ergon_names.source_name(int(source_number))
        # As in the paper, the sign has a column of its own: the direction in which the ergon
        # strikes.
        impulse_sign = "-" if impulse < 0 else "+"
        struck_name, lever_ratio = struck_by_mat[mat]
        struck_mass, speed, impulse = (
            struck_mass * lever_ratio * lever_ratio,
            abs(speed) / lever_ratio,
            abs(impulse) * lever_ratio,
        )
        yield (
            time,
            struck_name,
            impulse_sign,
            struck_mass,
            speed,
            impulse,
            source_by_number[source_number],
        )
