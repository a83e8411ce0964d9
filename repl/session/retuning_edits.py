"""The version edit that moves an instrument, or the score, to another tuning."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ergon.repl.language.retuning import Retune
from ergon.repl.session.edit_table import makes_edit, with_texts
from ergon.repl.session.version import GLIDE_DURATION, Version, piece_from_files
from ergon.scores.edits import retuning

if TYPE_CHECKING:
    from ergon.repl.session.waiting_lines import VersionEdit


@makes_edit(Retune)
def _retune(command: Retune) -> VersionEdit:
    """Retune, gliding for the length `over`; a scale is read once, when the line is typed."""
    texts_by_file: dict[str, str] = {}

    def edit(version: Version, edit_beat: float) -> Version:
        texts_before = replace(version.texts, overlay={**texts_by_file, **version.texts.overlay})
        retuned_texts, texts_read = retuning.retune(texts_before, command.target, command.fields)
        texts_by_file.update(texts_read)
        if texts_read:
            piece_from_files(
                replace(retuned_texts, sealed=False)
            )  # refuses a file outside the bounds
        new_texts = {
            file: text for file, text in texts_by_file.items() if file not in version.texts.overlay
        }
        base_texts = version.file_texts
        if new_texts:
            written_texts = base_texts or version.texts
            base_texts = replace(written_texts, overlay={**new_texts, **written_texts.overlay})
        glide = GLIDE_DURATION
        if command.over is not None:
            tempo_map = version.piece.tempo_map
            glide = max(
                glide,
                tempo_map.seconds(tempo_map.after(edit_beat, command.over))
                - tempo_map.seconds(edit_beat),
            )
        return replace(
            with_texts(version, retuned_texts),
            read_files=new_texts,
            file_texts=base_texts,
            glide_duration=glide,
        )

    return edit
