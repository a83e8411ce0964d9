"""Options that several commands share."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from .bundled import ScorePath
from .console import Console

F = TypeVar("F", bound=Callable[..., Any])
_HAS_UNIT = re.compile(r"\d\s*[^\W\d]+$")  # no exponent: that ends in a digit


class Number(click.FloatRange):
    """A number within bounds, which may have its unit: `48000` and `48kHz` are the same rate.

    NaN, which no comparison finds, is outside of all bounds.
    """

    def __init__(
        self,
        min: float | None = None,
        max: float | None = None,
        dimension: str | None = None,
        *,
        min_open: bool = False,
    ) -> None:
        """`dimension` is one of those in `notation.tables.quantities`; without it no unit may be
        written.
        """
        super().__init__(min, max, min_open=min_open)
        self.dimension = dimension

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number that was written, in SI units. Raises click.BadParameter."""
        if self.dimension is not None and isinstance(value, str) and _HAS_UNIT.search(value):
            value = self._quantity(value, self.dimension, param, ctx)
        try:
            number: float = super().convert(value, param, ctx)
        except click.BadParameter as error:
            raise self._with_units(error, param, ctx) from None
        if not math.isfinite(number):
            self.fail(f"{value} is not a number that can be used here.", param, ctx)
        return number

    def _quantity(
        self, text: str, name: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        from ergon.notation.tables import quantities
        from ergon.notation.text.errors import TextError

        try:
            return quantities.quantity(text, getattr(quantities, name))
        except TextError as error:
            self.fail(error.message, param, ctx)

    def _with_units(
        self, error: click.BadParameter, param: click.Parameter | None, ctx: click.Context | None
    ) -> click.BadParameter:
        """The same mistake, with the units that may be written."""
        if self.dimension is None:
            return error
        from ergon.notation.tables import quantities

        units = ", ".join(getattr(quantities, self.dimension).units)
        message = f"{error.message.rstrip('.')}; without a space, a unit may follow: {units}."
        return click.BadParameter(message, ctx, param)


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
        help="Play a player's key by a device, such as remi=firefader:/dev/ttyACM0#1, or without "
        "one, such as remi=page:; repeatable.",
    ),
    click.option(
        "--unchecked",
        is_flag=True,
        help="Do not try the direction of each motor before it plays.",
    ),
    click.option("--force-max", type=Number(0, 200, "FORCE"), help="Largest force on a hand [N]."),
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
