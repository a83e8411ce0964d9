"""`ergon play` and `ergon duet`: a score through loudspeakers, with hands beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from . import options
from .console import Console


def _playing(command: Any) -> Any:
    """The options that `play` and `duet` share."""
    for option in (
        click.option("--from", "from_", metavar="POSITION", help="Begin here (3|1, B+2, 12.5s)."),
        click.option(
            "--audio",
            default="auto",
            show_default=True,
            metavar="WHERE",
            help="jack[:PORTS], pulse[:SINK], file:PATH, null or auto.",
        ),
        click.option(
            "--block", type=click.IntRange(16, 8192), help="Frames of the card at a time."
        ),
        click.option(
            "--ahead", type=click.IntRange(64, 1 << 20), help="Frames kept ready for the card."
        ),
        click.option("--gain", metavar="LEVEL", help="Instead of what a preflight finds: -12dB."),
        click.option(
            "--frozen",
            type=click.Path(path_type=Path, file_okay=False),
            metavar="DIR",
            help="Prepared parts (ergon render --freeze) are read, not computed.",
        ),
        click.option("--loop", is_flag=True, help="Begin again at the end, until Ctrl-C."),
        click.option("--plain", is_flag=True, help="Print lines, redraw nothing."),
        click.option("--osc", metavar="[HOST:]PORT", help="Hear OSC there; this machine's alone."),
        click.option("--osc-to", metavar="HOST:PORT", help="Tell by OSC what is played, and when."),
        click.option("--strict", is_flag=True, help="Exit 5 when sound was late."),
        options.seed,
        options.accuracy,
        options.trust,
        options.speaking,
    ):
        command = option(command)
    return command


@click.command()
@options.score
@_playing
def play(console: Console, score_path: str, **given: Any) -> None:
    """Play a score through the loudspeakers.

    Live players are played by what stands in for them;
    `ergon duet` puts hands there. Ctrl-C ends it within 10 ms.
    """
    _play(console, score_path, **given)


@click.command()
@options.score
@click.option(
    "--live",
    multiple=True,
    metavar="PLAYER=DEVICE",
    help="A hand on a key, such as remi=firefader:/dev/ttyACM0#1.",
)
@click.option(
    "--guide",
    multiple=True,
    metavar="PLAYER[=K]",
    help="The written hand leads the real key, by so many N/m.",
)
@click.option("--standin", multiple=True, metavar="PLAYER=TAKE", help="Another stand-in.")
@click.option("--record", metavar="FILE.take", help="Keep what the hands do.")
@click.option("--unchecked", is_flag=True, help="Try no axis for its direction first.")
@click.option("--force-max", type=click.FloatRange(0, 200), help="Most force on a hand [N].")
@_playing
def duet(console: Console, score_path: str, **given: Any) -> None:
    """Play a score with real hands beside written ones.

    Every `--live` puts a device's axis under a player's key: it moves the key and feels what the
    key feels. Where no device is given or one is lost, the player's take or part stands in. Before
    an axis plays for the first time a small pulse finds out which way it goes.
    """
    _play(console, score_path, **given)


def _play(console: Console, score_path: str, *, plain: bool, strict: bool, **given: Any) -> None:
    """Play a score to its end, or until Ctrl-C."""
    from dataclasses import replace
    from functools import partial

    from ergon.api.play import PlayOptions, begin, prepare, warn_of_scaled_forces

    from .performance import Shown

    asked = PlayOptions(**given)
    ready = prepare(score_path, asked, console)
    stage, config, osc = ready.stage, ready.config, ready.osc
    while True:
        performance = begin(stage, config, console)
        shown = Shown(console, stage, performance, ready.boards, strict=strict, plain=plain)
        shown.run(osc, config, partial(warn_of_scaled_forces, performance, stage, console))
        if not asked.loop or (osc is not None and osc.stopped):
            return
        config = replace(config, start=0)
