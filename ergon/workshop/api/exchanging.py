"""Scores for other programs, and models of other programs as scores."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ergon.api.errors import OptionError
from ergon.common.report import Report
from ergon.workshop.api.export import (
    ExportedPart,
    ExportOptions,
    faust_programs,
    mi_gen_models,
    mode_tables,
)
from ergon.workshop.api.export_csound import csound_orchestras

if TYPE_CHECKING:
    from ergon.workshop.api.model import ImportedModel, ModelOptions

Format = Literal["modal", "faust", "mdl", "csound"]

# The functions that write the files of parts, by format.
FORMATS: Mapping[str, Callable[..., Sequence[ExportedPart]]] = {
    "modal": mode_tables,
    "faust": faust_programs,
    "mdl": mi_gen_models,
    "csound": csound_orchestras,
}


def export(
    score: str | Path,
    to: Format,
    options: ExportOptions | None = None,
    *,
    report: Report | None = None,
) -> tuple[ExportedPart, ...]:
    """Parts of a score for another program, as texts: tables of modes (CSV), programs of Faust,
    models of mi-gen, orchestras of Csound.

    Raises ScoreError, OptionError, and ModelError with the places of what cannot be exported.
    """
    if to not in FORMATS:
        raise OptionError("to", f"there is no format '{to}'; there are {', '.join(FORMATS)}")
    return tuple(FORMATS[to](score, options, report=report))


def import_(
    path: str | Path, options: ModelOptions | None = None, *, beside: str | Path = "."
) -> ImportedModel:
    """A model of another program as the text of a score: MIMS and mi-gen, pmpd of Pure Data,
    Synth-A-Modeler, miPhysics. Files of inputs are named from the folder `beside` on.

    Raises ModelError with the line at fault, DialectError if two dialects can read the model and
    it sounds different in each, OptionError, and OSError.
    """
    from ergon.workshop.api.model import ModelOptions, import_model

    return import_model(path, options or ModelOptions(), beside=beside)
