"""Options that several commands share."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from .bundled import ScorePath
from .console import Console

F = TypeVar("F", bound=Callable[..., Any])


class Number(click.FloatRange):
    """A number within bounds. NaN, which no comparison finds, is outside of all."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number that was written. Raises click.BadParameter."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a number that can be used here.", param, ctx)
        return number


force = click.option(
    "-f",
    "--force",
    is_flag=True,
    help="Also overwrite files that ergon did not write, or that were edited since.",
)
dry_run = click.option(
    "-n", "--dry-run", "dry", is_flag=True, help="Print what would be written; write nothing."
)
trust = click.option(
    "--trust", is_flag=True, help="Allow the score to name files outside its folder."
)
frozen = click.option(
    "--frozen",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Read these parts (from `ergon render --freeze`) instead of computing them.",
)
seed = click.option(
    "--seed", type=int, help="Seed of every chance operation, instead of the score's."
)
on = click.option(
    "--on",
    metavar="WHERE",
    help="Share the work: local:N processes here, or the Dask scheduler tcp://HOST:PORT.",
)
score = click.argument("score_path", metavar="SCORE", type=ScorePath())


def several(*given: Callable[[F], F]) -> Callable[[F], F]:
    """Several options as one, shown in this order."""

    def add(command: F) -> F:
        for option in reversed(given):
            command = option(command)
        return command

    return add


def target(text: str) -> Callable[[F], F]:
    """The option `-o`, with its help text for this command."""
    return click.option("-o", "--output", metavar="FILE", help=text)


def speaking(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --json, -q and -v, and hand the command a Console as its first argument."""

    @click.option("--json", "as_json", is_flag=True, help="Write JSON lines to stdout.")
    @click.option("-q", "--quiet", is_flag=True, help="Print errors only.")
    @click.option("-v", "--verbose", is_flag=True, help="Print more messages.")
    @functools.wraps(command)
    def spoken(*args: Any, as_json: bool, quiet: bool, verbose: bool, **options: Any) -> Any:
        console = Console(json=as_json, quiet=quiet, verbose=verbose)
        return command(console, *args, **options)

    return spoken


# Accuracy, in place of the score's own.
accuracy = several(
    click.option(
        "--method",
        metavar="NAME",
        help="Compute all parts by one method: ca, modal, ca2p, bm4 or ieq.",
    ),
    click.option(
        "--error",
        metavar="LEVEL",
        help="Largest error of the waveform, below the sound's own level, such as -60dB.",
    ),
    click.option("--cents", type=Number(0.01, 1200), help="Largest error of a pitch, in cents."),
    click.option(
        "--plan", metavar="FILE", help="Compute by the plan in this file (from `ergon plan -o`)."
    ),
)
draft = click.option(
    "--draft",
    is_flag=True,
    help="Begin at once, by the cheapest methods that are stable; the accuracy is not searched.",
)

# Sound output of a performance.
sound = several(
    click.option(
        "--audio",
        default="auto",
        show_default=True,
        metavar="WHERE",
        help="Where the sound goes: jack[:PORTS], pulse[:SINK], file:PATH, null or auto.",
    ),
    click.option(
        "--audio-in",
        default="auto",
        show_default=True,
        metavar="WHERE",
        help="Where inputs are heard: jack[:PORTS], pulse[:SOURCE], none or auto.",
    ),
    click.option(
        "--block",
        type=click.IntRange(16, 8192),
        help="Frames that the sound card takes at a time.",
    ),
    click.option(
        "--ahead",
        type=click.IntRange(64, 1 << 20),
        help="Frames computed before the sound card asks for them.",
    ),
    click.option(
        "--gain",
        metavar="LEVEL",
        help="Gain of the sound, such as -12dB, in place of what `normalise` would measure.",
    ),
    click.option(
        "--to",
        metavar="WHERE",
        help="Fold the score's layout: binaural, stereo, ambix1 … ambix7, or another layout.",
    ),
    click.option("--head", metavar="FILE.sofa", help="Another head for --to binaural."),
)

# OSC with other programs during a performance.
osc = several(
    click.option(
        "--osc",
        metavar="[HOST:]PORT",
        help="Accept OSC requests at this port; without HOST from your programs here alone.",
    ),
    click.option(
        "--osc-to", metavar="HOST:PORT", help="Send by OSC what is played, and when it is heard."
    ),
)

view_at = click.option(
    "--view-at",
    metavar="HOST:PORT",
    help="Show it here. Default: any free port of this machine. The address has a key.",
)

# Pages that show a performance.
view = several(
    click.option("--view", is_flag=True, help="Show in a browser what moves while it plays."),
    view_at,
)

see = click.option(
    "--see",
    type=click.Choice(["all"]),
    help="With --view: all computes what nobody hears too.",
)

# Real hands of a performance, and limits that protect them.
hands = several(
    click.option(
        "--live",
        multiple=True,
        metavar="PLAYER=DEVICE",
        help="Play a player's key by a device, such as remi=firefader:/dev/ttyACM0#1; repeatable.",
    ),
    click.option(
        "--unchecked",
        is_flag=True,
        help="Do not try the direction of each motor before it plays.",
    ),
    click.option("--force-max", type=Number(0, 200), help="Largest force on a hand [N]."),
)


def parse_bits(context: click.Context, parameter: click.Parameter, value: str | None) -> Any:
    """`--bits` as a number, or the word float."""
    return int(value) if value in ("16", "24") else value


bits = click.option(
    "--bits",
    type=click.Choice(["16", "24", "float"]),
    callback=parse_bits,
    help="Bits of a sample, or float; without this option as the score says.",
)
