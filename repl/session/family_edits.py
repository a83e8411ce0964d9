"""Version edits that bring families of instruments into a score."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.repl.language.library import Use
from ergon.repl.session.disk import read_text
from ergon.repl.session.edit_table import makes_edit, with_texts
from ergon.repl.session.version import NotTakenError, Version, piece_from_files
from ergon.scores.edits import families

if TYPE_CHECKING:
    from ergon.repl.session.waiting_lines import VersionEdit
    from ergon.scores.edits.texts import Texts
    from ergon.scores.reading.piece import Piece


@makes_edit(Use)
def _use_family(command: Use) -> VersionEdit:
    """Bring in a family; its file is read once, when the line is typed."""
    texts_by_file: dict[str, str] = {}

    def edit(version: Version, beat: float) -> Version:
        if command.family in version.piece.used:
            suggested_line = f"instruments {command.family}"
            raise NotTakenError(f"{command.family} is in use already", suggested_line)
        texts_with_read_files = replace(
            version.texts, overlay={**texts_by_file, **version.texts.overlay}
        )
        texts_with_family, texts_read = families.with_family(
            texts_with_read_files, command.family, command.file
        )
        texts_by_file.update(texts_read)
        piece_from_files(
            replace(texts_with_family, sealed=False)
        )  # refuses a file outside the bounds
        new_texts = {
            file: text for file, text in texts_by_file.items() if file not in version.texts.overlay
        }
        base_texts = version.file_texts or version.texts
        base_texts = replace(base_texts, overlay={**new_texts, **base_texts.overlay})
        return replace(
            with_texts(version, texts_with_family), read_files=new_texts, file_texts=base_texts
        )

    return edit


def with_brought_files(disk_texts: Texts, old_texts: Texts) -> Texts:
    """Texts of the disk with the files that `use` has brought in since, as they are there now.

    `old_texts` are the texts of the disk as the session knew them, with these files.
    """
    brought_files = (
        old_texts.overlay.keys() - old_texts.load().files.keys() - disk_texts.overlay.keys()
    )
    texts_read = {file: read_text(Path(file)) for file in brought_files}
    brought_texts = {
        file: old_texts.overlay[file] if text is None else text for file, text in texts_read.items()
    }
    return replace(disk_texts, overlay={**disk_texts.overlay, **brought_texts})


def family_summary(command: Use, piece: Piece) -> str:
    """The instruments that a family has brought, and those whose names are taken."""
    summary_sentence = f"{command.family}: {_instrument_names(command, piece)}"
    unplayed = families.unplayed_instruments(piece)
    full_names = [name for name in piece.available if name.startswith(f"{command.family}.")]
    short_and_full_names = [(name.rpartition(".")[2], name) for name in full_names]
    taken_names = [
        name for name, full_name in short_and_full_names if unplayed.get(name) != full_name
    ]
    if not taken_names:
        return summary_sentence
    verb, pronoun = ("is", "it") if len(taken_names) == 1 else ("are", "each")
    example = f"{taken_names[0]}2 = {command.family}/{taken_names[0]}"
    return (
        f"{summary_sentence}; {', '.join(taken_names)} {verb} not replaced, because the score has "
        f"{pronoun} already "
        f"(`{example}` adds another)"
    )


def _instrument_names(command: Use, piece: Piece) -> str:
    """The instruments of a family, by name."""
    family_prefix = f"{command.family}."
    names = [
        name.removeprefix(family_prefix)
        for name in piece.available
        if name.startswith(family_prefix)
    ]
    return ", ".join(names) or "no instruments"
