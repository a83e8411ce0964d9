"""Files of a score: read once, within bounds, found beside the naming file or in the library."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from ergon.scores.text.document import Document, compose
from ergon.scores.text.errors import Collector
from ergon.scores.text.memory import Memory
from ergon.scores.text.sections import remembered
from ergon.scores.text.syntax import MAX_BYTES, decode
from ergon.scores.text.values import Place

MAX_FILES = 256  # that one score reads
_PACKAGE = Path(__file__).parents[2]
_LIBRARY = {"instruments": _PACKAGE / "instruments" / "library"}
_SHIPPED = _PACKAGE / "scores" / "library"


def is_file(path: Path) -> bool:
    """Whether a regular file is there; a name that no file can have is not."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def shipped(path: Path) -> str | None:
    """The name by which scores use a file that ships; None for one of their own."""
    for prefix, root in (*_LIBRARY.items(), ("", _SHIPPED)):
        if path.is_relative_to(root):
            return str(PurePosixPath(prefix, path.relative_to(root).as_posix()))
    return None


def installed(name: str) -> Path:
    """Where a file that ships is installed, by the name by which scores use it."""
    first, *rest = PurePosixPath(name).parts
    root = _LIBRARY.get(first)
    return _SHIPPED / name if root is None else root.joinpath(*rest)


def is_shipped(path: Path) -> bool:
    """Whether a file is, or would be, in the installed library, by whatever name and link."""
    real = os.path.realpath(path)
    roots = (os.path.realpath(root) for root in (*_LIBRARY.values(), _SHIPPED))
    return any(real == root or real.startswith(root + os.sep) for root in roots)


def is_below(path: Path, folder: Path) -> bool:
    """Whether a file is, or would be, in a folder or below it, with all links followed."""
    real, root = os.path.realpath(path), os.path.realpath(folder)
    return real.startswith(root.rstrip(os.sep) + os.sep)


class Files:
    """Reads YAML files; `overlay` holds texts that stand for files (an editor's, a test's).

    Where it is `sealed` no text is read from the disk that is neither in `overlay` nor ships, and
    no other file from outside `home`.

    A file in `home`, the score's folder, stands for the one that ships under the same name, for
    files of the library too: so a copy that is changed is the one that is meant.
    """

    def __init__(
        self,
        collector: Collector,
        overlay: Mapping[str, str] | None = None,
        memory: Memory | None = None,
        sealed: bool = False,
    ) -> None:
        """Start with nothing read, but for what is remembered."""
        self.collector = collector
        self.memory = memory
        self.documents: dict[str, Document] = {}
        self.home: Path | None = None
        self._overlay = {str(Path(name)): text for name, text in (overlay or {}).items()}
        self._sealed = sealed

    def find(self, name: str, folder: Path, *, is_text: bool = True) -> Path | None:
        """A file relative to a folder or to `home`, or one that ships; None when there is none.

        What is no text (a take) is never in the overlay.
        """
        candidates = [folder / name]
        parts = PurePosixPath(name).parts
        if parts and ".." not in parts and not Path(name).is_absolute():
            if self.home is not None and folder != self.home:
                candidates.append(self.home / name)
            if parts[0] in _LIBRARY and len(parts) > 1:
                candidates.append(_LIBRARY[parts[0]].joinpath(*parts[1:]))
            candidates.append(_SHIPPED / name)
        for path in candidates:
            if str(path) in self._overlay or (self._may_read(path, is_text) and is_file(path)):
                return path
        return None

    def _may_read(self, path: Path, is_text: bool) -> bool:
        if not self._sealed or shipped(path) is not None:
            return True
        try:
            return not is_text and self.home is not None and is_below(path, self.home)
        except (OSError, ValueError):  # a name that no file can have
            return False

    def text(self, name: str, text: str, folder: Path) -> Document:
        """A document from a text that is at hand."""
        self.collector.file(name)
        text = text.removeprefix("\ufeff")
        if self.memory is not None:
            document = remembered(text, name, folder, self.collector, self.memory)
        else:
            document = compose(text, name, self.collector)
        document.folder = folder
        self.documents[name] = document
        return document

    def open(self, path: Path, asked: Place | None) -> Document | None:
        """A document from a file; None after a report at the place that asked for it."""
        name = str(path)
        if name in self.documents:
            return self.documents[name]
        if len(self.documents) >= MAX_FILES:
            self._refuse("E105", f"more than {MAX_FILES} files", name, asked)
            return None
        if name in self._overlay:
            return self.text(name, self._overlay[name], path.parent)
        try:
            with path.open("rb") as file:  # what read() may return is allocated first
                data = file.read(min(MAX_BYTES, path.stat().st_size) + 1)
        except OSError as error:
            reason = error.strerror or type(error).__name__
            self._refuse("E107", f"{name} cannot be read: {reason}", name, asked)
            return None
        self.collector.file(name)
        text = decode(data, name, self.collector)
        if text is None:
            self.documents[name] = Document(name, "")
            return None
        return self.text(name, text, path.parent)

    def required(self, name: str, folder: Path, asked: Place) -> Document | None:
        """The document that a file names; None after a report."""
        path = self.find(name, folder)
        if path is None:
            self._refuse(
                "E107", f"no file {name} beside {asked.file} or in the library", name, asked
            )
            return None
        return self.open(path, asked)

    def _refuse(self, code: str, message: str, name: str, asked: Place | None) -> None:
        self.collector.error(code, message, asked or Place(name, 1, 1))
