"""The version edit that moves an instrument, or the score, to another tuning."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ergon.repl.language.retuning import Retune
from ergon.repl.session.edit_table import makes_edit, with_texts
from ergon.repl.session.version import GLIDE, Version, piece_from_files
from ergon.scores.edits import retuning

if TYPE_CHECKING:
    from ergon.repl.session.waiting_lines import VersionEdit


@makes_edit(Retune)
def _retune(command: Retune) -> VersionEdit:
    """Retune, gliding for the length `over`; a scale is read once, when the line is typed."""
    read: dict[str, str] = {}

    def edit(version: Version, beat: float) -> Version:
        before = replace(version.texts, overlay={**read, **version.texts.overlay})
        texts, texts_read = retuning.retune(before, command.target, command.fields)
        read.update(texts_read)
        if texts_read:
            piece_from_files(replace(texts, sealed=False))  # a file outside the bounds is told of
        new = {file: text for file, text in read.items() if file not in version.texts.overlay}
        base = version.base
        if new:
            written = base or version.texts
            base = replace(written, overlay={**new, **written.overlay})
        glide = GLIDE
        if command.over is not None:
            tempo = version.piece.tempo_map
            glide = max(glide, tempo.seconds(tempo.after(beat, command.over)) - tempo.seconds(beat))
        return replace(with_texts(version, texts), read_files=new, base=base, glide=glide)

    return edit
