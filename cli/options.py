"""Options that several commands share."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import click

from .console import Console

F = TypeVar("F", bound=Callable[..., Any])

force = click.option("-f", "--force", is_flag=True, help="Overwrite files that are not ours.")
trust = click.option("--trust", is_flag=True, help="The score may name files outside its folder.")
seed = click.option("--seed", type=int, help="Another seed for every chance operation.")
score = click.argument("score_path", metavar="SCORE")
# Kept as text: what it may be (a file, `-`) is checked where it is opened, with a sentence.


def target(text: str) -> Callable[[F], F]:
    """`-o`, with what it means here."""
    return click.option("-o", "--output", metavar="FILE", help=text)


def speaking(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --json, -q and -v, and hand the command a Console as its first argument."""

    @click.option("--json", "as_json", is_flag=True, help="JSON lines on stdout.")
    @click.option("-q", "--quiet", is_flag=True, help="Only errors.")
    @click.option("-v", "--verbose", is_flag=True, help="Say more.")
    @functools.wraps(command)
    def spoken(*args: Any, as_json: bool, quiet: bool, verbose: bool, **options: Any) -> Any:
        console = Console(json=as_json, quiet=quiet, verbose=verbose)
        return command(console, *args, **options)

    return spoken


def accuracy(command: F) -> F:
    """How exact, instead of as the score says: --method, --error, --cents, or an earlier plan."""
    for option in (
        click.option("--plan", metavar="FILE", help="Compute by this plan (ergon plan -o)."),
        click.option("--cents", type=click.FloatRange(0.01, 1200), help="Most error of a pitch."),
        click.option("--error", metavar="LEVEL", help="Most error of the waveform, such as -60dB."),
        click.option(
            "--method",
            metavar="NAME",
            help="One method for all: ca, modal, ca2p, bm4, ieq or trapezoid.",
        ),
    ):
        command = option(command)
    return command


def parse_bits(context: click.Context, parameter: click.Parameter, value: str | None) -> Any:
    """`--bits` as the number it is, or the word float."""
    return int(value) if value in ("16", "24") else value


bits = click.option(
    "--bits",
    type=click.Choice(["16", "24", "float"]),
    callback=parse_bits,
    help="Form of the samples; without it as the score says.",
)
