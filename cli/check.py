"""`ergon check`: every mistake in scores, with its place; on request what their gestures do."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import TYPE_CHECKING

import click

from ergon.api import score
from ergon.api.check import try_stage
from ergon.api.options import ReadOptions

from . import options
from .console import Console, Form, plural
from .outcome import Findings
from .units import metres

if TYPE_CHECKING:
    from ergon.notation.text.errors import Diagnostic, Severity
    from ergon.rendering.follow import GestureFidelity
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece


@click.command()
@click.argument("scores", metavar="SCORE...", nargs=-1, required=True)
@click.option(
    "--simulate",
    is_flag=True,
    help="Also play the gestures, and say how closely their keys follow them.",
)
@click.option(
    "--format",
    "form",
    type=click.Choice(["full", "concise", "github"]),
    default="full",
    help="How mistakes are shown.",
)
@options.trust
@options.speaking
def check(
    console: Console, scores: tuple[str, ...], simulate: bool, form: Form, trust: bool
) -> None:
    """Report every mistake in scores, with its place.

    `-` reads a score from stdin. The exit code is 1 when a score has an error; warnings and notes
    are no errors.
    """
    console = Console(console.json, console.quiet, console.verbose, form)
    failed = 0
    for path in scores:
        try:
            _check(console, path, simulate, trust)
        except Findings as found:
            console.outcome(found)
            failed += 1
    if failed:
        raise Findings(f"{failed} of {plural(len(scores), 'score')}" if len(scores) > 1 else "")


def _check(console: Console, path: str, simulate: bool, trust: bool) -> None:
    loaded = score.read(path, ReadOptions(trust=trust), console)
    staged, found = try_stage(loaded, console)
    console.say(f"{path}: {_tally(loaded, found)}")
    if staged is None:
        raise Findings
    if simulate:
        from ergon.rendering.follow import follow

        with console.progress(f"simulating {path}", staged.n_frames, staged.rate) as progress:
            _report(console, staged.piece, follow(staged, progress.at))


def _tally(loaded: Loaded, more: Sequence[Diagnostic] = ()) -> str:
    """`2 errors, 1 warning`, or `no mistakes`; diagnostics that were not shown count too."""
    counts: dict[Severity, int] = {"error": 0, "warning": 0, "note": 0, **loaded.left_out}
    for found in (*loaded.diagnostics, *more):
        counts[found.severity] += 1
    return ", ".join(plural(n, kind) for kind, n in counts.items() if n) or "no mistakes"


def _report(console: Console, piece: Piece, fidelities: list[GestureFidelity]) -> None:
    for one in fidelities:
        at = None if isnan(one.worst_at) else score.where(piece, one.worst_at)
        if console.json:
            console.record(
                "followed",
                player=one.player,
                gesture=one.name,
                key=one.key,
                times=one.times,
                is_layer=one.is_layer,
                ergons=one.n_ergons,
                rms_m=one.rms,
                worst_m=one.worst,
                worst_at_s=one.worst_at,
                worst_at=at,
                pushed_by=one.pushed_by,
                strongest_m_s=one.strongest,
                missed=one.missed,
                first_points_missed=one.first_points_missed,
            )
            continue
        times = f" ×{one.times}" if one.times > 1 else ""
        words = f"{one.player} {one.name}{times} on {one.key}: "
        if one.is_layer:
            words += "a layer, added to the gesture that runs"
        elif one.n_ergons == 0:
            words += "ended by the next gesture before its first ergon"
        elif at is None:
            words += "followed exactly"
        else:
            words += f"followed within {metres(one.rms)} rms, worst {metres(one.worst)} at {at}"
            words += f", pushed by {one.pushed_by}" if one.pushed_by else ""
        if one.missed:
            words += f"; {plural(one.missed, 'step')} needed more than the force limit"
        if one.first_points_missed:
            words += f"; first point missed {plural(one.first_points_missed, 'time')}"
        console.data(words + "\n")
        console.detail(
            f"  {plural(one.n_ergons, 'ergon')}, the strongest {one.strongest:.3g} m/s; "
            f"free key from {metres(one.low)} to {metres(one.high)}"
        )
