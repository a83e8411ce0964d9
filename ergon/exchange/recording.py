"""Recordings of live hands for other programs, and movements from other programs as recordings."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO

from ergon.common.errors import ErgonError
from ergon.common.structured import MalformedTextError, parse_json

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Recording

    Column = tuple[str, NDArray[Any]]

_BLOCK_TICKS = 8192  # rows of a CSV, frames of a WAV, that are made at once
_TICKS_MAX = 20_000_000  # times axes: what a recording holds
_HEADER_SUBSTITUTES = str.maketrans(
    dict.fromkeys('[],;"#', "_")
)  # characters that a CSV header cannot hold


class NotRecordingError(ErgonError, ValueError):
    """A recording lacks the requested data, or the given data cannot become a recording."""


def read_description(recording: Recording) -> dict[str, Any]:
    """The description stored with the recording; empty if it is not a JSON object."""
    try:
        description = parse_json(recording.about)
    except MalformedTextError:
        return {}
    return description if isinstance(description, dict) else {}


def instants(recording: Recording) -> NDArray[np.float64]:
    """Times of the ticks [s] (n_ticks,), 0 at the first."""
    import numpy as np

    ticks = recording.ticks()
    return (ticks - ticks[:1]).astype(np.float64) * recording.frames / recording.rate


def positions_from_start(recording: Recording) -> NDArray[np.float64]:
    """Positions [m] at every tick of the piece from tick 0 to the last, (n_ticks, n_axes).

    With these positions a key repeats the movement of the recorded hand: before the first row it
    waits at the first position, and a missing tick holds the position before. Raises
    NotRecordingError if there are more positions than fit.
    """
    import numpy as np

    from ergon._core import EngineError

    try:
        tick_positions = recording.held()
    except EngineError as error:
        raise NotRecordingError(str(error)) from None
    if not len(tick_positions):
        raise NotRecordingError("the recording is empty")
    first_tick = int(recording.ticks()[0])
    if (first_tick + len(tick_positions)) * tick_positions.shape[1] > _TICKS_MAX:
        raise NotRecordingError("the recording begins too late in the piece")
    return np.concatenate([np.repeat(tick_positions[:1], first_tick, axis=0), tick_positions])


def columns(recording: Recording) -> list[Column]:
    """All columns of the rows: header with its unit, values (n_ticks,).

    The column of a position has the name of its axis, so that a score can play it by `channel`.
    """
    channel_names = [name.translate(_HEADER_SUBSTITUTES) for name in recording.names]
    if len(set(channel_names)) < len(channel_names) or {"t", "tick"} & set(channel_names):
        channel_names = [str(i + 1) for i in range(len(channel_names))]
    tick_positions, forces, sent_forces = (
        recording.positions(),
        recording.forces(),
        recording.sent(),
    )
    flags, clocks = recording.flags(), recording.clocks()
    row_columns: list[Column] = [("t [s]", instants(recording)), ("tick [1]", recording.ticks())]
    for i, channel_name in enumerate(channel_names):
        row_columns += [
            (f"{channel_name} [m]", tick_positions[:, i]),
            (f"{channel_name} force [N]", forces[:, i]),
            (f"{channel_name} sent [N]", sent_forces[:, i]),
            (f"{channel_name} flags [1]", flags[:, i]),
            (f"{channel_name} clock [1]", clocks[:, i]),
        ]
    return row_columns


def csv_rows(recording: Recording) -> Iterator[str]:
    """The text of a CSV in pieces; numbers are the shortest that read back to the same bits."""
    all_columns = columns(recording)
    row_buffer = io.StringIO()
    row_buffer.write(
        f"# take 1, made by ergon, {recording.rate:g} Hz, ticks of {recording.frames} frames\n"
    )
    rows = csv.writer(row_buffer, lineterminator="\n")
    rows.writerow([name for name, _ in all_columns])
    yield row_buffer.getvalue()
    for first_row in range(0, len(all_columns[0][1]), _BLOCK_TICKS):
        row_buffer = io.StringIO()
        lists = [values[first_row : first_row + _BLOCK_TICKS].tolist() for _, values in all_columns]
        csv.writer(row_buffer, lineterminator="\n").writerows(zip(*lists, strict=True))
        yield row_buffer.getvalue()


def write_npz(npz_file: BinaryIO, recording: Recording) -> None:
    """The columns of a CSV as arrays of an npz."""
    import numpy as np

    arrays: dict[str, Any] = dict(columns(recording))
    np.savez(npz_file, **arrays)


def write_wav(wav_file: BinaryIO, recording: Recording) -> None:
    """Positions at the audio rate, a channel for each axis; 1.0 is 1 m.

    Between ticks the samples follow the spline that a score would play; frame 0 is the first
    tick.
    """
    import numpy as np

    from ergon._core import Take, single

    from .wave import WaveWriter
    from .wave_header import Stamp, WaveFormat

    rate = int(recording.rate)
    if rate != recording.rate:
        raise NotRecordingError(
            f"a WAV file has a whole number of frames per second, not {recording.rate:g}"
        )
    tick_instants, positions = instants(recording), recording.positions()
    if len(tick_instants) < 2:
        raise NotRecordingError("a movement needs two ticks or more")
    takes = [
        Take(tick_instants, np.ascontiguousarray(positions[:, i]))
        for i in range(positions.shape[1])
    ]
    ticks = recording.ticks()
    n_frames = int(ticks[-1] - ticks[0]) * recording.frames + 1
    format = WaveFormat(rate, len(takes), "float")
    writer = WaveWriter(wav_file, format, n_frames, Stamp(", ".join(recording.names)))
    for first_frame in range(0, n_frames, _BLOCK_TICKS):
        block_instants = (
            np.arange(first_frame, min(first_frame + _BLOCK_TICKS, n_frames)) / recording.rate
        )
        block = np.stack([take.positions(block_instants) for take in takes], axis=1)
        writer.write(single(block, 1.0))
    writer.close()


def recording_of_movements(
    movements_by_name: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]],
    *,
    rate: float,
    frames: int,
    source: str,
) -> Recording:
    """A recording of movements (t [s], x [m]) by name; tick 0 is the earliest beginning.

    Values between samples are taken from the spline that a score would play.
    """
    import numpy as np

    from ergon._core import EngineError, Recording, Take

    first_instant = min(t[0] for t, _ in movements_by_name.values())
    last_instant = max(t[-1] for t, _ in movements_by_name.values())
    # The last tick counts even if rounding puts the last sample slightly before it.
    n_ticks = np.floor((last_instant - first_instant) * rate / frames + 1e-6) + 1
    if not n_ticks * len(movements_by_name) <= _TICKS_MAX:
        raise NotRecordingError(
            f"{last_instant - first_instant:g} s is longer than a recording can be at this rate"
        )
    ticks = np.arange(int(n_ticks), dtype=np.uint64)
    tick_instants = first_instant + ticks.astype(np.float64) * frames / rate
    try:
        positions = np.stack(
            [
                Take(t, positions).positions(tick_instants)
                for t, positions in movements_by_name.values()
            ],
            axis=1,
        )
        description = json.dumps({"imported": source}, ensure_ascii=False)
        axes: Sequence[tuple[str, str]] = [(name, "") for name in movements_by_name]
        return Recording(rate, frames, axes, description, ticks, np.ascontiguousarray(positions))
    except EngineError as error:
        raise NotRecordingError(str(error)) from None
