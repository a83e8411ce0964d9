"""`ergon take info`: what a take holds, and whether it is whole."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ergon.common.foreign_files import foreign_file
from ergon.common.terminal import printable

from . import options
from .console import Console, plural
from .outcome import Refused
from .recording import NAMES_MAX, SUFFIX, read_quietly
from .units import metres_text, seconds_text

if TYPE_CHECKING:
    from ergon._core import Recording
    from ergon.scores.gesture.summary import Column, Table


@click.command()
@click.argument("file", metavar="FILE")
@options.with_console
def info(console: Console, file: str) -> None:
    """Say what a take holds, and whether it is whole.

    Of a recording (.take) it says the hands, the duration, the range of positions and forces, and
    what was lost. Of a table (CSV, TSV, npz) or motion capture (C3D, BVH, TRC, SDIF) it says the
    channels.
    """
    from ergon.scores.gesture.summary import SUFFIXES

    path = Path(file)
    if path.suffix.lower() not in (SUFFIX, *SUFFIXES):
        if (foreign_kind := foreign_file(path)) is not None:
            raise Refused(f"{file}: {foreign_kind}")
        *other_suffixes, last_suffix = (SUFFIX, *SUFFIXES)
        raise Refused(f"{file}: a take is a {', '.join(other_suffixes)} or {last_suffix} file")
    take(console, path)


def take(console: Console, path: Path) -> None:
    """Say what a take in any of these forms holds."""
    if path.suffix.lower() == SUFFIX:
        _recording(console, path)
    else:
        _table(console, path)


def _recording(console: Console, path: Path) -> None:
    from ergon.exchange.recording import read_description

    hand_recording = read_quietly(path)
    ticks = hand_recording.ticks()
    first_instant = (
        float(ticks[0]) * hand_recording.frames / hand_recording.rate if len(ticks) else None
    )
    summary = read_description(hand_recording)
    axes = _axes(hand_recording)
    if console.json:
        console.record(
            "take",
            file=str(path),
            rate_hz=hand_recording.rate,
            frames=hand_recording.frames,
            ticks=len(ticks),
            first_tick=int(ticks[0]) if len(ticks) else None,
            duration_s=hand_recording.duration,
            axes=axes,
            events=len(hand_recording.events),
            dropped=hand_recording.dropped,
            lost_bytes=hand_recording.lost_bytes,
            finished=hand_recording.finished,
            about=summary,
        )
        return
    rate = hand_recording.rate / hand_recording.frames
    lines = [
        f"{path}: {seconds_text(hand_recording.duration)}, {plural(len(ticks), 'tick')} at "
        f"{rate:.2f} Hz ({hand_recording.frames} frames of {hand_recording.rate:g} Hz)"
    ]
    if first_instant is not None:
        lines.append(f"  begins {first_instant:.3f} s into the piece")
    for axis in axes:
        words = [f"  {axis['name']}"]
        if axis["key"] and axis["key"] != axis["name"]:
            words.append(f" on {axis['key']}")
        if len(ticks):
            words.append(f": {metres_text(axis['low'])} … {metres_text(axis['high'])}")
            words.append(f", force up to {axis['force_n']:.3g} N")
            if axis["tripped"]:
                words.append(f", limiter tripped in {plural(axis['tripped'], 'tick')}")
        lines.append("".join(words))
    if hand_recording.events:
        lines.append(f"  {plural(len(hand_recording.events), 'event')}")
    for name, value in summary.items():
        setting_values = list(value.values()) if isinstance(value, dict) else [value]
        if words := [word for word in setting_values if isinstance(word, str)]:
            lines.append(f"  {name}: {', '.join(words)}")
    if hand_recording.dropped:
        lines.append(
            f"  {plural(hand_recording.dropped, 'row')} or events were lost for want of room"
        )
    lines.append(f"  {hand_recording.damage or 'whole'}")
    console.data("\n".join(printable(line[:NAMES_MAX]) for line in lines) + "\n")


def _axes(take: Recording) -> list[dict[str, Any]]:
    """Figures of each hand."""
    positions, forces, flags = take.positions(), take.forces(), take.flags()
    axes: list[dict[str, Any]] = []
    for axis_index, (name, (player, key)) in enumerate(zip(take.names, take.axes, strict=True)):
        axis: dict[str, Any] = {"name": name, "player": player, "key": key}
        if len(positions):
            axis |= {
                "low": float(positions[:, axis_index].min()),
                "high": float(positions[:, axis_index].max()),
                "force_n": float(abs(forces[:, axis_index]).max()),
                "tripped": int((flags[:, axis_index] & 16 != 0).sum()),
                "stand_in": int((flags[:, axis_index] & 8 != 0).sum()),
            }
        axes.append(axis)
    return axes


def _table(console: Console, path: Path) -> None:
    from ergon.scores.gesture.summary import summary
    from ergon.scores.gesture.take_file import TakeError

    try:
        table = summary(path)
    except TakeError as error:
        raise Refused(error.message) from None
    if table.note is not None:
        console.warn(f"{path}: {table.note}")
    time_column = next((column for column in table.columns if column.is_time), None)
    duration = _seconds(time_column) if time_column else None
    rate = (table.n_rows - 1) / duration if duration else None
    channels = [column for column in table.columns if column is not time_column]
    if console.json:
        console.record(
            "take",
            file=str(path),
            samples=table.n_rows,
            duration_s=duration,
            rate_hz=rate,
            channels=[
                {
                    "name": channel.name,
                    "low": channel.low_value,
                    "high": channel.high_value,
                    "not_finite": channel.n_missing,
                }
                for channel in channels
            ],
            passed_over=list(table.unread),
        )
        return
    length_texts = [plural(table.n_rows, "sample")]
    if duration and rate:
        length_texts.append(f"{seconds_text(duration)}, {rate:.3g} Hz on average")
    lines = [f"{path}: " + ", ".join(length_texts)]
    lines += [
        f"  {channel.name}: {channel.low_value:g} … {channel.high_value:g}, "
        f"from {channel.first_value:g} to {channel.last_value:g}{_missing(table, channel)}"
        if channel.low_value <= channel.high_value
        else f"  {channel.name}: never seen"
        for channel in channels
    ]
    lines += [f"  passed over: {passed_over}" for passed_over in table.unread]
    console.data("\n".join(printable(line) for line in lines) + "\n")


def _missing(table: Table, column: Column) -> str:
    """How many values of a column are not there, and where the first of them is."""
    if column.first_missing is None:
        return ""
    if table.has_hidden:
        frames = plural(column.n_missing, "frame")
        return f"; not seen in {frames}, first in frame {column.first_missing:,}"
    place_text = (
        f"sample {column.first_missing:,}"
        if column.line_missing is None
        else f"line {column.line_missing:,}"
    )
    verb = "is" if column.n_missing == 1 else "are"
    return (
        f"; {plural(column.n_missing, 'value')} {verb} not finite, first in {place_text}: a take "
        "of it "
        "is refused"
    )


def _seconds(time_column: Column) -> float | None:
    """The duration in a column of instants [s]; None if its unit is not one of time."""
    from ergon.scores.gesture.points import UNITS_PER_SECOND

    per_second = UNITS_PER_SECOND.get(time_column.name.partition("[")[2].strip(" ]") or "s")
    return (time_column.last_value - time_column.first_value) / per_second if per_second else None
