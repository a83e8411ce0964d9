"""`ergon play` and `ergon duet`: a score through loudspeakers, with hands beside it."""

from __future__ import annotations

from typing import Any

import click

from . import options
from .console import Console

# The options that `play` and `duet` share.
_playing = options.several(
    click.option(
        "--from",
        "from_",
        metavar="POSITION",
        help="Where to begin, such as '3|1' (in quotes), B+2 or 12.5s.",
    ),
    click.option("--until", metavar="POSITION", help="Where to stop, such as '5|1'."),
    options.sound,
    click.option(
        "--record-input",
        metavar="FILE.wav",
        help="Write what inputs hear into a new file, for `ergon render --input`.",
    ),
    options.frozen,
    click.option(
        "--loop",
        is_flag=True,
        help="Begin again at the end, until Ctrl-C; with --until again at --from.",
    ),
    click.option("--plain", is_flag=True, help="Print one line after the other; redraw none."),
    options.osc,
    options.view,
    options.see,
    click.option("--strict", is_flag=True, help="Exit with code 5 when sound was late."),
    options.seed,
    options.accuracy,
    options.draft,
    options.trust,
    options.speaking,
)


@click.command()
@options.score
@_playing
@click.option(
    "--watch",
    is_flag=True,
    help="Play each saved version of the score from the position that is reached.",
)
def play(console: Console, score_path: str, watch: bool, **given: Any) -> None:
    """Play a score through the loudspeakers.

    A player with a live hand plays its stand-in: its written part, or a take. `ergon duet` plays
    it by a device. Ctrl-C ends the performance within 10 ms.
    """
    if not watch:
        _play(console, score_path, **given)
        return
    from ergon.api.play import PlayOptions

    from .play_watch import play_watched

    strict = given.pop("strict")
    given.pop("plain")  # nothing is redrawn
    play_watched(console, score_path, PlayOptions(**given), strict=strict)


@click.command()
@options.score
@options.hands
@click.option(
    "--guide",
    multiple=True,
    metavar="PLAYER[=K]",
    help="Pull the real key along the player's written part, by a spring of K [N/m].",
)
@click.option(
    "--standin",
    multiple=True,
    metavar="PLAYER=TAKE",
    help="Play this take or gesture where the player has no device; repeatable.",
)
@click.option("--record", metavar="FILE.take", help="Record what the hands do into a new file.")
@_playing
def duet(console: Console, score_path: str, **given: Any) -> None:
    """Play a score with real hands beside written ones.

    Each `--live` connects one axis of a device to a player's key: the hand on it moves the key and
    feels the forces on the key. Without a device, or when a device is lost, the player's take or
    written part plays. Before an axis plays for the first time, a small pulse of force finds the
    direction of its motor.
    """
    _play(console, score_path, **given)


def _play(console: Console, score_path: str, *, plain: bool, strict: bool, **given: Any) -> None:
    """Play a score to its end, or until Ctrl-C."""
    from dataclasses import replace
    from functools import partial

    from ergon.api.play import PlayOptions, begin, prepare, warn_of_scaled_forces

    from .performance import ShownPerformance

    asked = PlayOptions(**given)
    ready = prepare(score_path, asked, console)
    stage, config, osc = ready.stage, ready.config, ready.osc
    try:
        while True:
            performance = begin(stage, config, console)
            shown = ShownPerformance(
                console, stage, performance, ready.hands, strict=strict, plain=plain
            )
            shown.run(osc, config, partial(warn_of_scaled_forces, performance, stage, console))
            if not asked.loop or (osc is not None and osc.stopped):
                return
            if asked.until is None:
                config = replace(config, start=0)
    finally:
        ready.close()
