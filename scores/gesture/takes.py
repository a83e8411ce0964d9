"""Captured movements: recordings, tables, WAV, motion capture, read in bounded memory.

* take: a recording of live hands; an axis is called by its player, or its key.
* CSV, TSV (`table_file.py`): a header `t [s],x [mm]`, then rows; `,`, `;` or tab between columns,
  `#` before comments.
* WAV: channels are numbered from 1; 1.0 is one `unit` (1 m by default).
* npz: one-dimensional arrays, `t` in seconds and channels in metres, or named `x [mm]`.
* C3D, BVH, TRC, TSV of Qualisys, CSV of OptiTrack (`motion.py`): a point and an axis, such as
  `RWRI.x`.
* SDIF (`sdif_file.py`): a column of a matrix, such as `XPOS.x`.

CSV and npz files without `t` need a `rate`; BVH and SDIF files and columns without a unit need a
`unit`, because they state none. GMS files cannot be read: what they hold is public
(Luciani and others, 2006), and no table of their bytes was at hand.
"""

from array import array
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ergon import _core
from ergon.common.foreign_files import foreign_file
from ergon.exchange import wave
from ergon.exchange.wave_header import NotWaveError
from ergon.notation.text.spelling import nearest
from ergon.scores.gesture import (
    bvh_file,
    c3d_file,
    motion,
    optitrack_file,
    qtm_file,
    sdif_file,
    trc_file,
)
from ergon.scores.gesture.npz import Npz, open_npz
from ergon.scores.gesture.points import UNITS_PER_METRE, UNITS_PER_SECOND
from ergon.scores.gesture.table_file import Sheet, read_sheet
from ergon.scores.gesture.take_file import (
    MAX_CHANNELS,
    MAX_SAMPLES,
    Floats,
    TakeError,
    open_text,
    parse_cell,
    time_order_error,
)

MAX_POSITION = 1e3  # m
MAX_RATE = 1e6  # Hz


class Samples(NamedTuple):
    """Positions `x` [m] at rising instants `t` [s], both (n,), and a note on damage."""

    t: Floats
    x: Floats
    damage: str | None = None


def read(
    path: Path, channel: str | None = None, *, rate: float | None = None, unit: float | None = None
) -> Samples:
    """Read one channel of a captured movement; `channel` may be left out if the file has only one.

    `rate` [Hz] is the sample rate of files without instants; `unit` [m] is the length of 1.0 in
    files that state no unit. Raises TakeError.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        if (foreign_kind := foreign_file(path)) is not None:
            raise TakeError(foreign_kind, path)
        suffixes = ", ".join(_READERS)
        raise TakeError(f"takes in '{path.suffix}' files cannot be read yet; use {suffixes}", path)
    if rate is not None and not 0.0 < rate <= MAX_RATE:
        raise TakeError(
            f"the rate must be above 0 and at most {MAX_RATE:,.0f} Hz", path, field="rate"
        )
    if unit is not None and not 0.0 < unit <= MAX_POSITION:
        raise TakeError("the unit must be a length above 0", path, field="unit")
    try:
        if not path.is_file():
            raise TakeError("the file does not exist", path)
        # A damaged file may have huge numbers; the result is checked below.
        with np.errstate(all="ignore"):
            samples = reader(path, channel, rate, unit)
    except OSError as error:
        raise TakeError(f"cannot be read: {error.strerror or error}", path) from None
    if len(samples.x) < 2:
        raise TakeError("a take needs two samples or more", path)
    return samples


def _read_table(
    path: Path, channel: str | None, rate: float | None, metre_unit: float | None
) -> Samples:
    with open_text(path) as file:
        try:
            take_table = read_sheet(file, path)
            table_columns = _columns(take_table.names, path, take_table.line)
            value_column, x_unit = _chosen_column(table_columns, channel, path)
            divisor = _column_divisor(take_table, value_column, x_unit, metre_unit, path)
            has_times = "t" in table_columns
            time_column, t_unit = table_columns.get("t", (value_column, "s"))
            _check_rate(has_times, rate, path)
            instants, positions = array("d"), array("d")
            for line_number, cells in take_table.rows:
                x = parse_cell(cells[value_column], path, line_number)
                if has_times:
                    row_instant = parse_cell(cells[time_column], path, line_number)
                    if instants and not row_instant > instants[-1]:
                        raise time_order_error(row_instant, instants[-1], path, line_number)
                    instants.append(row_instant)
                if len(positions) == MAX_SAMPLES:
                    raise TakeError(
                        f"the file has more than {MAX_SAMPLES:,} samples", path, line_number
                    )
                positions.append(x)
        except UnicodeDecodeError:
            raise TakeError("this is not text in UTF-8", path) from None
    if has_times:
        times = np.frombuffer(instants) / _unit_divisor(
            t_unit or "s", UNITS_PER_SECOND, "time", path
        )
    else:
        times = np.arange(len(positions)) / (rate or 1.0)
    return _checked_samples(times, np.frombuffer(positions) / divisor, path)


def _column_divisor(
    take_table: Sheet,
    column_index: int,
    stated_unit: str | None,
    metre_unit: float | None,
    path: Path,
) -> float:
    """Units of a column in a metre, by its header or by `metre_unit` [m]. Raises TakeError."""
    if stated_unit is not None:
        _check_unit(metre_unit, path)
        return _unit_divisor(stated_unit, UNITS_PER_METRE, "position", path)
    if metre_unit is None:
        message = (
            f"'{take_table.names[column_index][:40]}' has no unit; write a header such as t [s],x "
            "[mm], or what 1.0 means, such as unit: 1mm"
        )
        raise TakeError(message, path, take_table.line, field="unit")
    return 1.0 / metre_unit


def _columns(
    column_names: list[str], path: Path, header_number: int | None
) -> dict[str, tuple[int, str | None]]:
    """Name → (column, unit) of headers such as `x [mm]`; the unit is None where none is stated."""
    columns_by_name: dict[str, tuple[int, str | None]] = {}
    for i, column_name in enumerate(column_names):
        name_text, bracket, unit_text = column_name.partition("[")
        name_text = name_text.strip()
        if not name_text or (bracket and not unit_text.endswith("]")):
            message = (
                f"'{column_name[:40]}' is not the name of a column; write a header such as t [s],x "
                "[mm]"
            )
            raise TakeError(message, path, header_number)
        if name_text in columns_by_name:
            raise TakeError(f"two columns are called '{name_text[:40]}'", path, header_number)
        columns_by_name[name_text] = (i, unit_text[:-1].strip() if bracket else None)
    if len(columns_by_name) > MAX_CHANNELS:
        raise TakeError(f"the file has more than {MAX_CHANNELS:,} columns", path, header_number)
    return columns_by_name


def _chosen_column(
    columns_by_name: Mapping[str, tuple[int, str | None]], channel_name: str | None, path: Path
) -> tuple[int, str | None]:
    """The column and unit of a channel, or of the only one."""
    channel_names = [name for name in columns_by_name if name != "t"]
    if channel_name is None and len(channel_names) == 1:
        channel_name = channel_names[0]
    listed_names = ", ".join(channel_names[:8])
    if channel_name is None:
        raise TakeError(
            f"the file has several channels; write `channel` as one of {listed_names}"
            if listed_names
            else "no channel",
            path,
        )
    if channel_name not in channel_names:
        raise TakeError(
            f"no channel '{channel_name[:40]}'; there are {listed_names}",
            path,
            suggestion=nearest(channel_name, channel_names),
            field="channel",
        )
    return columns_by_name[channel_name]


def _unit_divisor(
    unit_name: str, units_by_name: dict[str, float], quantity: str, path: Path
) -> float:
    if not unit_name or unit_name not in units_by_name:
        unit_names = ", ".join(filter(None, units_by_name))
        raise TakeError(
            f"unit '{unit_name[:40]}' does not measure {quantity} (use {unit_names})", path
        )
    return units_by_name[unit_name]


def _check_rate(has_instants: bool, rate: float | None, path: Path) -> None:
    if has_instants and rate is not None:
        raise TakeError("the file has times of its own; remove `rate`", path, field="rate")
    if not has_instants and rate is None:
        raise TakeError(
            "the file has no column 't [s]'; write the rate of the samples, such as rate: 1kHz",
            path,
        )


def _check_unit(unit: float | None, path: Path) -> None:
    if unit is not None:
        raise TakeError("the file states its own unit; remove `unit`", path, field="unit")


def _checked_samples(t: Floats, x: Floats, path: Path) -> Samples:
    for name, values in (("t", t), ("x", x)):
        if not (is_finite := np.isfinite(values)).all():
            raise TakeError(f"sample {int(is_finite.argmin()) + 1} of {name} is not finite", path)
    steps = np.diff(t)
    if not (is_rising := steps > 0.0).all():
        raise TakeError(f"times must rise: sample {int(is_rising.argmin()) + 2} does not", path)
    if not (is_step_valid := steps > 0.9 / MAX_RATE).all():
        sample_number = int(is_step_valid.argmin()) + 2
        raise TakeError(
            f"sample {sample_number} follows the one before in less than a microsecond", path
        )
    if x.size and float(np.abs(x).max()) > MAX_POSITION:
        raise TakeError(f"the file has positions of more than {MAX_POSITION:,.0f} m", path)
    return Samples(t, x)


def _read_wav(
    path: Path, channel: str | None, rate: float | None, metre_unit: float | None
) -> Samples:
    try:
        info = wave.read_info(path)
        if info.damage is not None:
            raise TakeError(info.damage, path)
        _check_rate(True, rate, path)
        n_channels = info.format.n_channels
        if n_channels > MAX_CHANNELS:
            raise TakeError(f"the file has more than {MAX_CHANNELS:,} channels", path)
        if info.n_frames > MAX_SAMPLES:
            raise TakeError(f"the file has more than {MAX_SAMPLES:,} samples", path)
        channels_by_name = {str(i + 1): (i, "m") for i in range(n_channels)}
        column_index, _ = _chosen_column(channels_by_name, channel, path)
        channel_blocks = [block[:, column_index].copy() for block in wave.read_blocks(path)]
    except NotWaveError as error:
        raise TakeError(str(error), path) from None
    x = np.concatenate(channel_blocks) if channel_blocks else np.empty(0)
    return _checked_samples(
        np.arange(len(x)) / float(info.format.rate), x * (metre_unit or 1.0), path
    )


def _read_npz(path: Path, channel: str | None, rate: float | None, unit: float | None) -> Samples:
    _check_unit(unit, path)
    default_headers = {"t": "t [s]"}
    with open_npz(path) as arrays:
        headers = [
            name if "[" in name else default_headers.get(name, f"{name} [m]")
            for name in arrays.names
        ]
        columns_by_name = _columns(headers, path, None)
        column_index, x_unit = _chosen_column(columns_by_name, channel, path)
        has_instants = "t" in columns_by_name
        _check_rate(has_instants, rate, path)
        x = _read_array(arrays, column_index, path) / _unit_divisor(
            x_unit or "m", UNITS_PER_METRE, "position", path
        )
        if not has_instants:
            return _checked_samples(np.arange(len(x)) / (rate or 1.0), x, path)
        t_column, t_unit = columns_by_name["t"]
        t = _read_array(arrays, t_column, path) / _unit_divisor(
            t_unit or "s", UNITS_PER_SECOND, "time", path
        )
    if len(t) != len(x):
        raise TakeError(f"{len(t):,} times and {len(x):,} positions", path)
    return _checked_samples(t, x, path)


def _read_array(arrays: Npz, column_index: int, path: Path) -> Floats:
    array_row = arrays.row(column_index)
    if array_row is None:
        raise TakeError(f"'{arrays.names[column_index][:40]}' is not a row of numbers", path)
    return arrays.array(array_row)


def _read_recording(
    path: Path, channel_name: str | None, rate: float | None, metre_unit: float | None
) -> Samples:
    _check_rate(True, rate, path)
    _check_unit(metre_unit, path)
    try:
        recording = _core.read_recording(path)
    except _core.EngineError as error:
        raise TakeError(str(error), path) from None
    axis = (
        0
        if channel_name is None and len(recording.axes) == 1
        else _recorded_axis(recording, channel_name, path)
    )
    ticks = recording.ticks()
    # Time counts from the recording's beginning, which may lie in the middle of a piece.
    t = (ticks - ticks[:1]).astype(np.float64) * recording.frames / recording.rate
    x = np.ascontiguousarray(recording.positions()[:, axis])
    return _checked_samples(t, x, path)._replace(damage=recording.damage)


def _recorded_axis(recording: _core.Recording, channel_name: str | None, path: Path) -> int:
    """The axis with a name: its own, or that of its player or key if they have only one axis."""
    axes_by_name = {name: (i, "m") for i, name in enumerate(recording.names)}
    if channel_name not in axes_by_name:
        indices = [
            i for i, axis in enumerate(recording.axes) if channel_name and channel_name in axis
        ]
        if len(indices) == 1:
            return indices[0]
    return _chosen_column(axes_by_name, channel_name, path)[0]


_Reader = Callable[[Path, str | None, float | None, float | None], Samples]


def _read_tsv(path: Path, channel: str | None, rate: float | None, unit: float | None) -> Samples:
    read_rows = _capture_reader(qtm_file.read) if qtm_file.is_qtm(path) else _read_table
    return read_rows(path, channel, rate, unit)


def _read_csv(path: Path, channel: str | None, rate: float | None, unit: float | None) -> Samples:
    is_motive = optitrack_file.is_optitrack(path)
    read_rows = _capture_reader(optitrack_file.read) if is_motive else _read_table
    return read_rows(path, channel, rate, unit)


def _read_sdif(path: Path, channel: str | None, rate: float | None, unit: float | None) -> Samples:
    _check_rate(True, rate, path)
    return _checked_samples(*sdif_file.read_track(path, channel, unit), path)


def _capture_reader(read_motion: Callable[[Path], motion.Motion]) -> _Reader:
    """A reader of a format of motion capture."""

    def read_points(
        path: Path, channel: str | None, rate: float | None, unit: float | None
    ) -> Samples:
        t, x, damage = motion.channel_track(read_motion(path), channel, rate, unit, path)
        return _checked_samples(t, x, path)._replace(damage=damage)

    return read_points


_READERS: dict[str, _Reader] = {
    ".take": _read_recording,
    ".csv": _read_csv,
    ".tsv": _read_tsv,
    ".wav": _read_wav,
    ".npz": _read_npz,
    ".c3d": _capture_reader(c3d_file.read),
    ".bvh": _capture_reader(bvh_file.read),
    ".trc": _capture_reader(trc_file.read),
    ".sdif": _read_sdif,
}
