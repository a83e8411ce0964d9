"""Meters of a file of notes, as a score has them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from ergon.notation.clock.meter import Bars, Meter
from ergon.notation.text.errors import TextError
from ergon.scores.gesture.take_file import TakeError

_Meter = TypeVar("_Meter")


def read_meters(
    path: Path, meters: Iterable[tuple[float, _Meter]], read_meter: Callable[[_Meter], Meter]
) -> tuple[tuple[float, Meter], ...]:
    """Meters by quarter notes from the beginning, each read by `read_meter`, which raises
    TextError.

    Raises TakeError for a meter that no score has, and for one that does not begin on a bar line.
    """
    bar_map, placed_meters = Bars(), []
    last_quarter, last_beat = 0.0, 0.0
    for quarter, file_meter in meters:
        meter_beat = bar_map.after_quarters(last_beat, quarter - last_quarter)
        last_quarter, last_beat = quarter, meter_beat
        try:
            meter = read_meter(file_meter)
            bar_map.change(meter_beat, meter)
        except TextError as error:
            message = f"its meter {quarter:g} quarters after the beginning: {error.message}"
            raise TakeError(message, path) from None
        placed_meters.append((quarter, meter))
    return tuple(placed_meters)
