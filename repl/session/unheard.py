"""Unheard parts: a line that makes or changes one is refused if it cannot be played.

A plan leaves out unheard parts, so the engine first looks at such a part when a later
line lets it be heard. That line would be refused for a mistake of the earlier one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ergon._core import EngineError, UnstableError
from ergon.notation.text.errors import Collector
from ergon.scores.reading.digest import is_same
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.refusals import stage_error

if TYPE_CHECKING:
    from ergon.scores.staging.stage import Stage


def check_unheard(old_piece: Piece, stage: Stage) -> None:
    """Check the unheard instruments of a stage that the piece `old_piece` lacks, or has
    with other values. Raises StageError for each module that the engine refuses.
    """
    piece, known_instruments = stage.piece, old_piece.instruments
    plan_rows = () if stage.plan is None else stage.plan.rows()
    changed_names = [
        name
        for row in plan_rows
        if row.what == "unheard"
        for name in row.parts
        if name in piece.instruments
        and not (
            name in known_instruments and is_same(known_instruments[name], piece.instruments[name])
        )
    ]
    if not changed_names:
        return
    try:
        stage.network.certify(stage.rate)
    except UnstableError:  # if the part is heard, the plan takes a stable method
        return
    except EngineError as error:
        refusals = [
            module_error
            for module_error in error.refusals or [error]
            if _is_in_parts(changed_names, module_error.module)
        ]
        if refusals:
            error.refusals = refusals
            raise stage_error(piece, Collector(), error) from error


def _is_in_parts(parts: Sequence[str], module: str | None) -> bool:
    return module is not None and any(module.startswith(f"{part}.") for part in parts)
