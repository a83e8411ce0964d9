"""Every mistake in a score, with its place."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report

from . import score as scores
from .options import ReadOptions

if TYPE_CHECKING:
    from ergon.notation.text.errors import Diagnostic
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage


@dataclass(frozen=True, slots=True)
class Checked:
    """The diagnostics of a score, in the order of its files.

    There are at most 20 each of errors, warnings and notes; `left_out` counts the others by
    severity.
    """

    diagnostics: tuple[Diagnostic, ...]
    left_out: dict[str, int]

    @property
    def is_playable(self) -> bool:
        """Whether the score has no error; it may have warnings and notes."""
        return not self.errors

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The diagnostics that are errors."""
        return tuple(
            diagnostic for diagnostic in self.diagnostics if diagnostic.severity == "error"
        )


def check(
    score: str | Path, options: ReadOptions | None = None, *, report: Report | None = None
) -> Checked:
    """Check a score, and whether the engine can play it.

    A mistake in the score is a diagnostic, and raises nothing.
    """
    loaded = scores.read(score, options, report)
    _, staging_diagnostics = try_stage(loaded, report)
    diagnostics = (*loaded.diagnostics, *staging_diagnostics)
    return Checked(
        diagnostics, {severity: count for severity, count in loaded.left_out.items() if count}
    )


def try_stage(loaded: Loaded, report: Report | None) -> tuple[Stage | None, list[Diagnostic]]:
    """The staged score (None where it has errors), and the diagnostics of the engine."""
    if loaded.piece is None:
        return None, []
    from ergon import _core
    from ergon.scores.staging.highest_modes import highest_modes, warn_low_modes, warn_over_limit
    from ergon.scores.staging.implausible import warn_implausible
    from ergon.scores.staging.preparing import prepare
    from ergon.scores.staging.refusals import StageError
    from ergon.scores.staging.unused import warn_unused

    staged = None
    try:
        staged = stage_as_checked(loaded.piece, report)
        diagnostics = [
            *warn_unused(loaded.piece),
            *warn_implausible(loaded.piece),
            *staged.diagnostics,
        ]
        diagnostics += warn_low_modes(highest_modes(loaded.piece, staged.built_network))
        diagnostics += warn_over_limit(loaded.piece, staged.built_network, staged.paths)
    except StageError as error:
        diagnostics = list(error.diagnostics)
        if loaded.piece.automation and any(diagnostic.code == "E309" for diagnostic in diagnostics):
            # If the engine refuses the network itself, there is nothing to look at.
            with contextlib.suppress(_core.EngineError):
                prepared = prepare(loaded.piece)
                diagnostics += warn_over_limit(loaded.piece, prepared.built_network, prepared.paths)
    scores.show(report, loaded, diagnostics)
    return staged, diagnostics


def stage_as_checked(piece: Piece, report: Report | None) -> Stage:
    """Stage a piece, by a plan if it names an accuracy, else as written. Raises StageError."""
    from ergon.exchange.plan_store import user_store
    from ergon.scores.reading.outputs import Accuracy
    from ergon.scores.staging.recording_stages import stage_or_plan
    from ergon.scores.staging.stage import stage

    with (report or Report()).waiting("planning"):
        if piece.accuracy != Accuracy():
            return stage(piece, planned=True, store=user_store())
        return stage_or_plan(piece, store=user_store())
