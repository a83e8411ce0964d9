"""Reports modules that the engine refuses, at the place where they are written."""

from __future__ import annotations

from collections.abc import Sequence

from ergon import _core
from ergon.common.errors import ErgonError
from ergon.notation.text.errors import Collector, Diagnostic
from ergon.notation.text.values import Place
from ergon.scores.reading.piece import Piece


class StageError(ErgonError):
    """The engine refuses the piece; `diagnostics` give the reasons, each with its place."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        """Take the diagnostics."""
        super().__init__("\n".join(diagnostic.message for diagnostic in diagnostics))
        self.diagnostics = list(diagnostics)


def place_of(piece: Piece, engine_name: str | None) -> Place:
    """Where the module that the engine names is written; if in another file, where its part is
    written.
    """
    engine_name = engine_name or ""
    coupling_links = [("duet", coupling.link, coupling.link.place) for coupling in piece.duet]
    keys = [(key.name, module, key.place) for key in piece.keys.values() for module in key.modules]
    instrument_modules = [
        (instrument.name, module, instrument.place)
        for instrument in piece.instruments.values()
        for module in instrument.modules
    ]
    for part, part_module, part_place in (*keys, *instrument_modules, *coupling_links):
        full_name = ".".join(filter(None, (part, part_module.name)))
        if engine_name == full_name or engine_name.startswith(f"{full_name}."):
            return part_module.place if part_module.place.file == part_place.file else part_place
    return piece.place


def report_refusals(piece: Piece, collector: Collector, error: _core.EngineError) -> None:
    """Report each module that the engine refuses (E309)."""
    for refusal in getattr(error, "refusals", ()) or (error,):
        collector.error(
            "E309", str(refusal.args[0]), place_of(piece, getattr(refusal, "module", None))
        )


def stage_error(piece: Piece, collector: Collector, error: _core.EngineError) -> StageError:
    """An error with all diagnostics, including this refusal."""
    report_refusals(piece, collector, error)
    return StageError(collector.finish())
