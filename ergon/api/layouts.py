"""Layouts of loudspeakers by name, from files or the library; `scores.reading` checks them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.errors import ErgonError
from ergon.common.report import Report

from .errors import ScoreError

if TYPE_CHECKING:
    from ergon.instruments.model import Layout
    from ergon.space.fold_filters import Field


class NoLayoutError(ErgonError, LookupError):
    """No layout has this name."""


def read_layout(name: str | Path, report: Report | None = None) -> Layout:
    """A layout from a file, or from the library by its name (`dome24`).

    Raises NoLayoutError, and ScoreError where the file has mistakes.
    """
    from ergon.notation.text.bounds import SHIPPED_SCORES_FOLDER, FileBounds
    from ergon.notation.text.errors import Collector, quote
    from ergon.notation.text.files import Files, is_file
    from ergon.notation.text.spelling import nearest
    from ergon.notation.text.values import Place
    from ergon.scores.reading import build_mix

    path = Path(name)
    if not is_file(path):
        shipped_layouts = {
            layout_path.stem: layout_path
            for layout_path in sorted((SHIPPED_SCORES_FOLDER / "layouts").glob("*.yaml"))
        }
        if path.name not in shipped_layouts or path.name != str(name):
            nearest_name = nearest(path.stem, shipped_layouts)
            suggestion_text = f"did you mean {nearest_name}? " if nearest_name else ""
            shipped_names = ", ".join(shipped_layouts)
            message = (
                f"{quote(str(name))} is not a layout file; {suggestion_text}The library has "
                f"{shipped_names}"
            )
            raise NoLayoutError(message.replace("; The", "; the"))
        path = shipped_layouts[path.name]
    collector = Collector()
    score_files = Files(collector, path.parent, bounds=FileBounds.around(path.parent, trust=True))
    layout = build_mix.layout(path.name, path.parent, Place(str(path), 1, 1), score_files)
    is_refused = collector.has_errors()
    diagnostics = collector.finish()
    (report or Report()).diagnostics(diagnostics, score_files.documents, collector.left_out())
    if layout is None or is_refused:
        raise ScoreError(diagnostics, score_files.documents)
    return layout


def layout_chunks(field: Field, title: str) -> bytes:
    """The chunks of a WAVE file (ADM) that describe channels of loudspeakers or Ambisonics."""
    from ergon.exchange import adm
    from ergon.space.directions import angles

    speakers = tuple(angles(place) for place in field.speakers)
    return adm.chunks(adm.ChannelLayout(speakers, field.order), title)


def chunks_of_layout(layout: Layout | None, n_channels: int, title: str) -> bytes:
    """The same for a score's layout; empty without one, or if the file has other channels."""
    if layout is None or layout.channels != tuple(range(n_channels)):
        return b""
    from ergon.space.fold_filters import Field

    return layout_chunks(Field(layout.speakers), title)
