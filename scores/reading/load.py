"""Reads a score's text to a checked piece, with everything that is wrong with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ergon.notation.tables import tuning
from ergon.notation.text.bounds import FileBounds
from ergon.notation.text.document import Document
from ergon.notation.text.errors import Collector, Diagnostic, Severity
from ergon.notation.text.files import Files
from ergon.notation.text.memory import Memory
from ergon.notation.text.without_gc import without_gc
from ergon.scores.reading.check import Checker
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.uses import Names, Uses


@dataclass(frozen=True, slots=True)
class Loaded:
    """The piece (None if there are errors), the diagnostics, and the files for showing lines."""

    piece: Piece | None
    diagnostics: list[Diagnostic]
    files: Mapping[str, Document]
    left_out: Mapping[Severity, int]
    names: Names | None = None  # names it defines or brings in; None without a text
    uses: Uses | None = None  # the reader of these names

    @property
    def has_errors(self) -> bool:
        """Whether the score was refused."""
        return self.piece is None

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Every file that the score is read from: its texts, its takes and its MIDI files."""
        takes = self.piece.takes.values() if self.piece is not None else ()
        paths = (*map(Path, self.files), *(take.path for take in takes if take.path is not None))
        return paths if self.uses is None else (*paths, *self.uses.midi_uses.paths)


@without_gc
def load(
    path: str | Path,
    *,
    text: str | None = None,
    overlay: Mapping[str, str] | None = None,
    memory: Memory | None = None,
    bounds: FileBounds | None = None,
    sealed: bool = False,
) -> Loaded:
    """Check a score. With `text`, `path` only names it (and its folder); `-` is standard input.

    `overlay` gives texts in place of files; if `sealed`, texts are read only from there and from
    the library. `memory` is for callers that read nearly the same score again. Files that the
    score names must lie within `bounds`, by default within its folder. Mistakes in the score
    raise nothing.
    """
    collector = Collector() if memory is None else memory.begin()
    score_path = Path(path)
    score_files = Files(collector, score_path.parent, overlay, memory, bounds, sealed=sealed)
    if text is not None:
        document: Document | None = score_files.text(str(path), text, score_path.parent)
    else:
        document = score_files.open(score_path, None)
    piece, score_names, uses = None, None, None
    if document is not None and document.root is None and not collector.has_errors():
        collector.error("E103", "the score is empty", document.place(0))
    if document is not None and document.root is not None:
        uses = Uses(score_files, collector)
        score_names = uses.read(document)
        if score_names.score is not None:
            with tuning.used(score_names.tuning):
                piece = Checker(score_names, uses).build_piece()
            if not collector.has_errors():
                uses.midi_uses.report(collector)
    if collector.has_errors():
        piece = None
        if memory is not None and memory.is_loose:  # read again, for the places of mistakes
            return load(path, text=text, overlay=overlay, bounds=bounds, sealed=sealed)
    return Loaded(
        piece, collector.finish(), score_files.documents, collector.left_out(), score_names, uses
    )
