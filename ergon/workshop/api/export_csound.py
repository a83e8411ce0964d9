"""A score as an orchestra of Csound: banks of the modes of its parts."""

from __future__ import annotations

from pathlib import Path

from ergon.api import score as scores
from ergon.api.errors import OptionError
from ergon.api.parts import frequency_option
from ergon.common.report import Report

from .export import FREQUENCY_MAX, ExportedPart, ExportOptions, audible_parts, banks_of, part_banks


def csound_orchestras(
    score: str | Path, options: ExportOptions | None = None, *, report: Report | None = None
) -> tuple[ExportedPart, ...]:
    """The modes of a score as one orchestra of Csound, or of each of the `parts` that are named.

    A resonator for each mode goes from each point that is struck or touched to each output of
    positions, speeds or accelerations; the score of the file has the strikes of the piece, each
    on the nearest sample. Without `parts`, those whose motion is heard stand in one file, each
    output in a channel of its own. Modes are those of `mode_tables`. Raises ScoreError and
    OptionError.
    """
    from ergon.workshop.models.programs.bank import join_banks
    from ergon.workshop.models.programs.csound import BANK_MAX, orchestra

    options = options or ExportOptions()
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    upto = FREQUENCY_MAX if options.upto is None else frequency_option("upto", options.upto)
    with scores.staging(lambda: loaded, report):
        part_names = audible_parts(piece, options.parts)
        if options.parts:
            return banks_of(piece, loaded.inputs, part_names, upto, orchestra, BANK_MAX, report)
        banks = part_banks(piece, loaded.inputs, part_names, upto, BANK_MAX, report)
    if not banks:
        return ()
    title = Path(score).stem if str(score) != scores.STDIN else "score"
    bank = join_banks(title, [bank for bank, _ in banks])
    n_resonators = sum(len(path.modes) for path in bank.paths)
    if n_resonators > BANK_MAX:
        reason = f"the piece takes {n_resonators:,} resonators, and a file has {BANK_MAX:,} at most"
        raise OptionError("parts", f"{reason}; name the parts to write, or lower `upto`")
    warnings = tuple(
        f"{part_bank.name}: {warning}"
        for part_bank, bank_warnings in banks
        for warning in bank_warnings
    )
    return (ExportedPart(title, orchestra(bank), warnings, loaded.inputs),)
