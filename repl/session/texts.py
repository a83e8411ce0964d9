"""The texts of a version: a score, and the files that it uses where the session changed them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ergon.scores.reading.load import Loaded, load
from ergon.scores.reading.sections import SCORE
from ergon.scores.reading.uses import Names, Uses
from ergon.scores.text import edit
from ergon.scores.text.document import Document
from ergon.scores.text.edit import EditError
from ergon.scores.text.errors import Collector
from ergon.scores.text.files import Files, shipped
from ergon.scores.text.syntax import decode

SECTIONS = tuple(SCORE.by_name)  # where a new section goes


@dataclass(frozen=True, slots=True)
class Texts:
    """A score's name and text; `overlay` holds texts that stand for files, by their paths."""

    path: str
    text: str
    overlay: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def read(cls, path: str | Path) -> Texts:
        """The score in a file, its line breaks as they are. Raises OSError or EditError."""
        collector = Collector()
        text = decode(Path(path).read_bytes(), str(path), collector)
        if text is None:
            raise EditError(collector.finish()[0].message)
        return cls(str(path), text)

    def load(self) -> Loaded:
        """The piece that these texts are, or what is wrong with them."""
        return load(self.path, text=self.text, overlay=self.overlay)

    def document(self, file: str | None = None) -> Document:
        """The nodes of the score, or of another file. Raises EditError."""
        if file is None or file == self.path:
            return edit.read(self.text, self.path)
        if (text := self.overlay.get(str(Path(file)))) is not None:
            return edit.read(text, file)
        collector = Collector()
        document = Files(collector).open(Path(file), None)
        if document is None or collector.has_errors():
            raise EditError(collector.finish()[0].message)
        return document

    def changed(self, text: str, file: str | None = None) -> Texts:
        """The same with another text of the score, or of a file."""
        if file is None or file == self.path:
            return replace(self, text=text)
        return replace(self, overlay={**self.overlay, str(Path(file)): text})

    def names(self) -> tuple[Names, Uses]:
        """Every name that the score knows, with the node where it is written."""
        collector = Collector()
        uses = Uses(Files(collector, self.overlay), collector)
        uses.files.home = Path(self.path).parent
        document = uses.files.text(self.path, self.text, Path(self.path).parent)
        return uses.read(document), uses

    def files(self, folder: Path) -> Mapping[Path, str]:
        """What stands beside the score when it is written in a folder: the files that changed.

        One that ships becomes the score's own, under the name by which it is used.
        """
        own = Path(self.path).parent
        found = {}
        for file, text in self.overlay.items():
            path, name = Path(file), shipped(Path(file))
            if name is None and path.is_relative_to(own):
                name = str(path.relative_to(own))
            found[folder / name if name is not None else path] = text
        return found

    def put(self, path: edit.Path, text: str, file: str | None = None) -> Texts:
        """Set a value. Raises EditError."""
        return self.changed(edit.put(self.document(file), path, text, SECTIONS), file)

    def append(self, path: edit.Path, text: str) -> Texts:
        """Add an item to a list. Raises EditError."""
        return self.changed(edit.append(self.document(), path, text, SECTIONS))

    def remove(self, *paths: edit.Path, file: str | None = None) -> Texts:
        """Take entries or items of one parent away. Raises EditError."""
        return self.changed(edit.remove(self.document(file), *paths), file)
