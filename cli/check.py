"""`ergon check`: every mistake in scores, with its place; on request what their gestures do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import click

from ergon.api import score
from ergon.api.check import try_stage
from ergon.api.options import ReadOptions

from . import options
from .bundled import ScorePath
from .console import Console, Form, plural
from .outcome import Findings

if TYPE_CHECKING:
    from ergon.notation.text.errors import Diagnostic, Severity
    from ergon.scores.reading.load import Loaded


@click.command()
@click.argument("scores", metavar="SCORE...", nargs=-1, required=True, type=ScorePath())
@click.option(
    "--simulate",
    is_flag=True,
    help="Also play the score: how closely keys follow gestures, how far masses swing, which "
    "contacts close.",
)
@click.option(
    "--format",
    "form",
    type=click.Choice(["full", "concise", "github"]),
    default="full",
    help="How mistakes are shown.",
)
@options.strict("when a score has a warning")
@options.trust
@options.with_console
def check(
    console: Console,
    scores: tuple[str, ...],
    simulate: bool,
    form: Form,
    strict: bool,
    trust: bool,
) -> None:
    """Report every mistake in scores, with its place.

    `-` reads a score from stdin. The exit code is 1 when a score has an error; warnings and notes
    are no errors, but --strict counts warnings.
    """
    console = Console(console.json, console.quiet, console.verbose, form)
    n_failed = 0
    for path in scores:
        try:
            _check(console, path, simulate, strict, trust)
        except Findings as findings:
            console.outcome(findings)
            n_failed += 1
    if n_failed:
        raise Findings(f"{n_failed} of {plural(len(scores), 'score')}" if len(scores) > 1 else "")


def _check(console: Console, path: str, simulate: bool, strict: bool, trust: bool) -> None:
    loaded = score.read(path, ReadOptions(trust=trust), console)
    staged, diagnostics = try_stage(loaded, console)
    counts = _counts(loaded, diagnostics)
    console.say(f"{path}: {_tally_text(counts)}")
    if staged is None or (strict and counts["warning"]):
        raise Findings
    if simulate:
        from .simulated import simulated

        simulated(console, path, loaded, staged.piece)


def _counts(loaded: Loaded, further_diagnostics: Sequence[Diagnostic] = ()) -> dict[Severity, int]:
    """How many there are of each severity; diagnostics that were not shown count too."""
    counts: dict[Severity, int] = {"error": 0, "warning": 0, "note": 0, **loaded.left_out}
    for diagnostic in (*loaded.diagnostics, *further_diagnostics):
        counts[diagnostic.severity] += 1
    return counts


def _tally_text(counts: Mapping[Severity, int]) -> str:
    """`2 errors, 1 warning`, or `no mistakes`."""
    return (
        ", ".join(plural(count, kind) for kind, count in counts.items() if count) or "no mistakes"
    )
