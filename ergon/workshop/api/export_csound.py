"""Parts of a score as orchestras of Csound: banks of their modes."""

from __future__ import annotations

from pathlib import Path

from ergon.api import score as scores
from ergon.api.parts import hertz
from ergon.common.report import Report

from .export import HIGHEST, ExportedPart, ExportOptions, audible_parts, banks_of


def csound_orchestras(
    score: str | Path, options: ExportOptions | None = None, *, report: Report | None = None
) -> tuple[ExportedPart, ...]:
    """The modes of parts of a score as orchestras of Csound, a `.csd` for each part with modes.

    A resonator for each mode goes from each point that is struck or touched to each output of
    positions, speeds or accelerations; the score of the file has the strikes of the piece, each
    on the nearest sample. Without `parts`, those whose motion is heard are written. Modes are
    those of `mode_tables`. Raises ScoreError and OptionError.
    """
    from ergon.workshop.models.programs.csound import BANK_MAX, orchestra

    options = options or ExportOptions()
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    upto = HIGHEST if options.upto is None else hertz("upto", options.upto)
    with scores.staging(lambda: loaded, report):
        names = audible_parts(piece, options.parts)
        return banks_of(piece, loaded.inputs, names, upto, orchestra, BANK_MAX, report)
