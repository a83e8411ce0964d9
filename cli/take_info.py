"""`ergon take info`: what a take holds, and whether it is whole."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ergon.common.terminal import printable

from . import options
from .console import Console, plural
from .outcome import Refused
from .recording import NAMES_MAX, SUFFIX, read_quietly
from .units import metres, seconds

if TYPE_CHECKING:
    from ergon._core import Recording
    from ergon.scores.gesture.summary import Column


@click.command()
@click.argument("file", metavar="FILE")
@options.speaking
def info(console: Console, file: str) -> None:
    """Say what a take holds, and whether it is whole.

    Of a recording (.take) it says the hands, the duration, the range of positions and forces, and
    what was lost. Of a table (CSV, TSV, npz) or motion capture (C3D, BVH, TRC, SDIF) it says the
    channels.
    """
    from ergon.scores.gesture.summary import SUFFIXES

    path = Path(file)
    if path.suffix.lower() not in (SUFFIX, *SUFFIXES):
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
    hand_axes = _axes(hand_recording)
    if console.json:
        console.record(
            "take",
            file=str(path),
            rate_hz=hand_recording.rate,
            frames=hand_recording.frames,
            ticks=len(ticks),
            first_tick=int(ticks[0]) if len(ticks) else None,
            duration_s=hand_recording.duration,
            axes=hand_axes,
            events=len(hand_recording.events),
            dropped=hand_recording.dropped,
            lost_bytes=hand_recording.lost_bytes,
            finished=hand_recording.finished,
            about=summary,
        )
        return
    rate = hand_recording.rate / hand_recording.frames
    info_lines = [
        f"{path}: {seconds(hand_recording.duration)}, {plural(len(ticks), 'tick')} at {rate:.2f} "
        "Hz "
        f"({hand_recording.frames} frames of {hand_recording.rate:g} Hz)"
    ]
    if first_instant is not None:
        info_lines.append(f"  begins {first_instant:.3f} s into the piece")
    for hand_axis in hand_axes:
        axis_words = [f"  {hand_axis['name']}"]
        if hand_axis["key"] and hand_axis["key"] != hand_axis["name"]:
            axis_words.append(f" on {hand_axis['key']}")
        if len(ticks):
            axis_words.append(f": {metres(hand_axis['low'])} … {metres(hand_axis['high'])}")
            axis_words.append(f", force up to {hand_axis['force_n']:.3g} N")
            if hand_axis["tripped"]:
                axis_words.append(f", limiter tripped in {plural(hand_axis['tripped'], 'tick')}")
        info_lines.append("".join(axis_words))
    if hand_recording.events:
        info_lines.append(f"  {plural(len(hand_recording.events), 'event')}")
    for figure_name, value in summary.items():
        setting_values = list(value.values()) if isinstance(value, dict) else [value]
        if axis_words := [word for word in setting_values if isinstance(word, str)]:
            info_lines.append(f"  {figure_name}: {', '.join(axis_words)}")
    if hand_recording.dropped:
        info_lines.append(
            f"  {plural(hand_recording.dropped, 'row')} or events were lost for want of room"
        )
    info_lines.append(f"  {hand_recording.damage or 'whole'}")
    console.data("\n".join(printable(line[:NAMES_MAX]) for line in info_lines) + "\n")


def _axes(take: Recording) -> list[dict[str, Any]]:
    """Figures of each hand."""
    tick_positions, forces, flags = take.positions(), take.forces(), take.flags()
    axis_figures: list[dict[str, Any]] = []
    for i, (name, (player, key)) in enumerate(zip(take.names, take.axes, strict=True)):
        hand_axis: dict[str, Any] = {"name": name, "player": player, "key": key}
        if len(tick_positions):
            hand_axis |= {
                "low": float(tick_positions[:, i].min()),
                "high": float(tick_positions[:, i].max()),
                "force_n": float(abs(forces[:, i]).max()),
                "tripped": int((flags[:, i] & 16 != 0).sum()),
                "stand_in": int((flags[:, i] & 8 != 0).sum()),
            }
        axis_figures.append(hand_axis)
    return axis_figures


def _table(console: Console, path: Path) -> None:
    from ergon.scores.gesture.summary import summary
    from ergon.scores.gesture.take_file import TakeError

    try:
        table_summary = summary(path)
    except TakeError as error:
        raise Refused(error.message) from None
    if table_summary.note is not None:
        console.warn(f"{path}: {table_summary.note}")
    time = next((column for column in table_summary.columns if column.is_time), None)
    duration_text = _seconds(time) if time else None
    rate = (table_summary.n_rows - 1) / duration_text if duration_text else None
    value_columns = [column for column in table_summary.columns if column is not time]
    if console.json:
        console.record(
            "take",
            file=str(path),
            samples=table_summary.n_rows,
            duration_s=duration_text,
            rate_hz=rate,
            channels=[{"name": c.name, "low": c.low, "high": c.high} for c in value_columns],
            passed_over=list(table_summary.passed_over),
        )
        return
    table_words = [plural(table_summary.n_rows, "sample")]
    if duration_text and rate:
        table_words.append(f"{seconds(duration_text)}, {rate:.3g} Hz on average")
    info_lines = [f"{path}: " + ", ".join(table_words)]
    info_lines += [
        f"  {c.name}: {c.low:g} … {c.high:g}, from {c.first:g} to {c.last:g}"
        if c.low <= c.high
        else f"  {c.name}: never seen"
        for c in value_columns
    ]
    info_lines += [f"  passed over: {passed_over}" for passed_over in table_summary.passed_over]
    console.data("\n".join(printable(line) for line in info_lines) + "\n")


def _seconds(instant_column: Column) -> float | None:
    """The duration in a column of instants [s]; None if its unit is not one of time."""
    from ergon.scores.gesture.points import UNITS_PER_SECOND

    per_second = UNITS_PER_SECOND.get(instant_column.name.partition("[")[2].strip(" ]") or "s")
    return (instant_column.last - instant_column.first) / per_second if per_second else None
