"""The state of a session's files on the disk, and which files it may write."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.regular import read_bounded
from ergon.notation.text import document, edit
from ergon.notation.text.edit import EditError
from ergon.notation.text.files import is_below, is_shipped, shipped
from ergon.notation.text.syntax import MAX_BYTES
from ergon.repl.session.journal_names import journal_name
from ergon.repl.session.version import NotTakenError
from ergon.scores.edits.texts import SECTIONS

if TYPE_CHECKING:
    from ergon.scores.edits.texts import Texts

_UTF8_BOM = b"\xef\xbb\xbf"


class Disk:
    """Hashes of the texts that were last read from files or written to them."""

    def __init__(self, known_hashes: Mapping[str, str] | None = None) -> None:
        """Begin with hashes by file name."""
        self._hash_by_file = dict(known_hashes or {})

    @classmethod
    def from_texts(cls, texts: Texts) -> Disk:
        """The state after these texts were read from the disk."""
        disk = cls()
        disk.note_read(texts)
        return disk

    def note_read(self, texts: Texts) -> None:
        """Note that texts were read from the disk."""
        self.note_written({texts.path: texts.text, **texts.overlay})

    def note_written(self, files: Mapping[str, str]) -> None:
        """Note that files were written with these texts."""
        self._hash_by_file.update((file, text_hash(text)) for file, text in files.items())

    def hashes(self) -> Mapping[str, str]:
        """Hashes by file, in hexadecimal."""
        return self._hash_by_file

    def hashes_by_name(self, texts: Texts) -> dict[str, str]:
        """Hashes by the names that a journal uses for the files of a score."""
        folder = Path(texts.path).parent
        hash_by_name = {
            journal_name(file, folder): file_hash for file, file_hash in self._hash_by_file.items()
        }
        return {
            name: file_hash for name, file_hash in hash_by_name.items() if not name.startswith("..")
        }

    def add_journal_hashes(self, hashes: Mapping[str, str]) -> None:
        """Add hashes from a journal; `check` compares files with them before they are
        overwritten.
        """
        self._hash_by_file.update(hashes)

    def unsaved_texts(self, score_texts: Texts) -> dict[str, str]:
        """The unsaved texts of the score and the files that it uses, by file."""
        folder = Path(score_texts.path).parent
        return {
            file: text
            for file, text in ((score_texts.path, score_texts.text), *score_texts.overlay.items())
            if self._hash_by_file.get(target_path(file, folder), self._hash_by_file.get(file))
            != text_hash(text)
        }

    def check_writable(self, file_name: str, score: Path) -> None:
        """Raise NotTakenError if a session with this score may not write a file."""
        path = Path(file_name)
        if is_shipped(path):
            raise NotTakenError(
                f"{file_name} ships with ergon and is never changed; `save NAME` writes a copy"
            )
        # The score may be a link, and its target is written; other files must be in its folder.
        if path != score and not is_below(path, score.parent):
            raise NotTakenError(f"{file_name} is outside the folder of the score, {score.parent}")
        if not os.path.lexists(file_name):
            if file_name in self._hash_by_file:
                raise NotTakenError(
                    f"{file_name} was deleted since it was read; `save NAME` writes another file"
                )
            return
        known_hash = self._hash_by_file.get(file_name)
        if known_hash is None:
            raise NotTakenError(
                f"{file_name} already exists, and this session did not write it: choose another "
                "name"
            )
        file_text = read_text(path)
        if file_text is None or text_hash(file_text) != known_hash:
            raise NotTakenError(
                f"{file_name} was changed on the disk since it was read: "
                "`save NAME` writes another file, `reload` reads the changed one"
            )
        if not is_score(file_text):
            raise NotTakenError(f"{file_name} is not a score, so `save` does not replace it")


def text_hash(text: str) -> str:
    """The hash of a text."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def target_path(file: str, folder: Path) -> str:
    """The path to which a file is written: a file of the library becomes one beside the score."""
    name = shipped(Path(file))
    return file if name is None else str(folder / name)


def read_text(path: Path) -> str | None:
    """The text of a file; None where it cannot be read as text."""
    try:
        content = read_bounded(path, MAX_BYTES)
        return content.decode("utf-8-sig") if len(content) <= MAX_BYTES else None
    except (OSError, UnicodeError):
        return None


def folder_of(score_texts: Texts) -> Path:
    """The folder that a session writes to: that of the score, or the current one if the score is in
    the library.
    """
    path = Path(score_texts.path)
    return Path() if is_shipped(path) else path.parent


def file_bytes(file_name: str, file_text: str) -> bytes:
    """The bytes with which a text replaces a file; a byte order mark of the file is kept."""
    try:
        with Path(file_name).open("rb") as old_file:
            has_mark = old_file.read(len(_UTF8_BOM)) == _UTF8_BOM
    except OSError:
        has_mark = False
    return (_UTF8_BOM if has_mark else b"") + file_text.encode()


def is_score(file_text: str) -> bool:
    """Whether all top-level keys of a text are sections of a score."""
    try:
        root = edit.read(file_text, "").root
    except EditError:
        return False
    return isinstance(root, document.Mapping) and all(name in SECTIONS for name in root.entries)
