"""`ergon layout check`: how well loudspeakers place sound."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from . import options
from .console import Console
from .tables import table

if TYPE_CHECKING:
    from ergon.instruments.model import Layout
    from ergon.space.quality import Quality

_COLUMN_NAMES = ("by", "|rE|", "least", "|rV|", "rE off", "most", "loudness")


@click.command()
@click.argument("name", metavar="LAYOUT")
@options.with_console
def check(console: Console, name: str) -> None:
    """Say how well loudspeakers place sound, and where they leave holes.

    LAYOUT is a file, or a layout that ships, such as dome24. 4,000 directions of the upper half are
    panned to the nearest loudspeaker, by VBAP and by AllRAD of order 3 and 5. The length of the
    energy vector rE says how narrow sound is (1: one loudspeaker), its direction how far beside its
    source it is heard.
    """
    from ergon.api.layouts import read_layout
    from ergon.space.quality import holes, is_open_above, is_symmetric, qualities

    layout = read_layout(name, console)
    speaker_positions = layout.speakers
    panning_qualities, speaker_holes = qualities(speaker_positions), holes(speaker_positions)
    sides_mirror, opens_above = is_symmetric(speaker_positions), is_open_above(speaker_positions)
    if console.json:
        for row in panning_qualities:
            _record(console, row)
        console.record(
            "layout",
            file=str(layout.path),
            loudspeakers=len(speaker_positions),
            symmetric=sides_mirror,
            surround=len(panning_qualities) > 1,
            open_above=opens_above,
            holes=[
                {"between": [layout.channels[a] + 1, layout.channels[b] + 1], "angle_deg": angle}
                for a, b, angle in speaker_holes
            ],
        )
        return
    title = f", {layout.title}" if layout.title else ""
    console.data(f"{len(speaker_positions)} loudspeakers{title}\n\n")
    console.data(table([_COLUMN_NAMES, *map(_row, panning_qualities)]))
    sides = "the sides mirror each other" if sides_mirror else "the sides do not mirror each other"
    console.data(f"\n{sides}\n")
    for a, b, angle in speaker_holes:
        console.data(
            f"a hole of {angle:.0f}° between {_speaker_text(layout, a)} and "
            f"{_speaker_text(layout, b)}\n"
        )
    if len(panning_qualities) == 1:
        console.data(
            "they do not surround the middle of the room, so sounds cannot be panned between them\n"
        )
    elif opens_above:
        console.data("a hole overhead: no loudspeaker lies within 60° of the zenith\n")
    elif not speaker_holes:
        console.data("no holes above the horizon\n")


def _row(quality: Quality) -> tuple[str, ...]:
    mean, least = quality.energy_length
    angle_off, farthest = quality.angles_off
    lowest_db, highest_db = quality.loudness
    return (
        quality.name,
        f"{mean:.3f}",
        f"{least:.3f}",
        f"{quality.velocity_length:.3f}",
        f"{angle_off:.1f}°",
        f"{farthest:.1f}°",
        f"{round(lowest_db, 1) + 0.0:+.1f}..{round(highest_db, 1) + 0.0:+.1f} dB",
    )


def _record(console: Console, quality: Quality) -> None:
    console.record(
        "panning",
        by=quality.name,
        re_mean=quality.energy_length[0],
        re_min=quality.energy_length[1],
        rv_mean=quality.velocity_length,
        off_mean_deg=quality.angles_off[0],
        off_max_deg=quality.angles_off[1],
        loudness_min_db=quality.loudness[0],
        loudness_max_db=quality.loudness[1],
    )


def _speaker_text(layout: Layout, speaker_index: int) -> str:
    from ergon.space.directions import angles

    azimuth, elevation, _ = angles(layout.speakers[speaker_index])
    return (
        f"{layout.channels[speaker_index] + 1} (azimuth {azimuth:.0f}°, elevation {elevation:.0f}°)"
    )
