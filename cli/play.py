"""`ergon play` and `ergon duet`: a score through loudspeakers, with hands beside it."""

from __future__ import annotations

from typing import Any

import click

from ergon.api.options import PlayOptions

from . import options
from .console import Console
from .outcome import Late

# The options that `play` and `duet` share.
_play_options = options.several(
    options.from_dataclass(PlayOptions, "from_ until"),
    options.sound,
    options.from_dataclass(PlayOptions, "record_input frozen loop"),
    click.option("--plain", is_flag=True, help="Print one line after the other; redraw none."),
    options.from_dataclass(PlayOptions, "osc osc_to view view_at see"),
    options.strict("when sound was late", Late.exit_code),
    options.from_dataclass(PlayOptions, "seed method error cents plan draft trust"),
    options.with_console,
)


@click.command()
@options.score
@options.hands
@_play_options
@click.option(
    "--watch",
    is_flag=True,
    help="Play each saved version of the score from the position that is reached.",
)
def play(console: Console, score_path: str, watch: bool, **arguments: Any) -> None:
    """Play a score through the loudspeakers.

    A player with a live hand plays its stand-in, which is its written part or a take, unless
    `--live` connects a device or a page (as for `ergon duet`). Ctrl-C ends the performance within
    10 ms.
    """
    if not watch:
        _play(console, score_path, **arguments)
        return
    from .play_watch import play_watched

    strict = arguments.pop("strict")
    arguments.pop("plain")  # nothing is redrawn
    play_watched(console, score_path, PlayOptions(**arguments), strict=strict)


@click.command()
@options.score
@options.hands
@options.from_dataclass(PlayOptions, "guide standin record")
@_play_options
def duet(console: Console, score_path: str, **arguments: Any) -> None:
    """Play a score with real hands beside written ones.

    Each `--live` connects one axis of a device to a player's key: the hand on it moves the key and
    feels the forces on the key. Without a device, or when a device is lost, the player's take or
    written part plays. Before an axis plays for the first time, a small pulse of force finds the
    direction of its motor.
    """
    _play(console, score_path, **arguments)


def _play(
    console: Console, score_path: str, *, plain: bool, strict: bool, **play_arguments: Any
) -> None:
    """Play a score to its end, or until Ctrl-C."""
    from dataclasses import replace
    from functools import partial

    from ergon.api.play import begin, prepare, warn_of_scaled_forces

    from .performance import ShownPerformance

    play_options = PlayOptions(**play_arguments)
    prepared = prepare(score_path, play_options, console)
    stage, config, osc = prepared.stage, prepared.config, prepared.osc
    try:
        while True:
            performance = begin(stage, config, console)
            shown_performance = ShownPerformance(
                console, stage, performance, prepared.hands, strict=strict, plain=plain
            )
            shown_performance.run(
                osc, config, partial(warn_of_scaled_forces, performance, stage, console)
            )
            if not play_options.loop or (osc is not None and osc.is_stop_requested):
                return
            if play_options.until is None:
                config = replace(config, start_frame=0)
    finally:
        prepared.close()
