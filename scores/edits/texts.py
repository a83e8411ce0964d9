"""The texts of a version: a score, and the files that it uses; with methods to edit them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from ergon.common.regular import read_bounded
from ergon.notation.text import document, edit
from ergon.notation.text.bounds import FileBounds
from ergon.notation.text.document import Document, Node
from ergon.notation.text.edit import EditError
from ergon.notation.text.elided import shorten
from ergon.notation.text.errors import Collector
from ergon.notation.text.files import Files
from ergon.notation.text.memory import Memory
from ergon.notation.text.sections import (
    Section,
    section_composed_alone,
    section_span,
    section_spans,
)
from ergon.notation.text.spans import Splice, apply_splices
from ergon.notation.text.syntax import MAX_BYTES, decode
from ergon.notation.text.window import Window, last_items, line_window
from ergon.scores.reading.load import Loaded, load
from ergon.scores.reading.sections import SCORE_RECORD
from ergon.scores.reading.uses import Names, Uses

SECTIONS = tuple(SCORE_RECORD.by_name)  # the order of sections


def _new_memory() -> Memory:
    return Memory(is_loose=True)


Change = Callable[[Document, int], str]  # gets the number of list items left out before
_FindWindow = Callable[[str, Section], Window | None]


@dataclass(frozen=True, slots=True)
class ListEdit:
    """A change of the list at a path, from item `first_index` on; None: an addition at its end."""

    path: edit.Path
    first_index: int | None
    change: Change

    def window(self, text: str, section: Section) -> Window | None:
        """The changed items as a text of their own; None if they cannot stand alone."""
        return last_items(text, section.name, section.node, self.path[1:], self.first_index)


@dataclass(frozen=True, slots=True)
class Texts:
    """A score's name and text; `overlay` holds texts in place of files, by their paths.

    Files that they name must lie within `bounds`, by default within the score's folder. `sealed`
    texts hold every file that the score uses: only takes and the library are read from the disk.
    Texts made from one another share a memory, because an edit changes little.
    """

    path: str
    text: str
    overlay: Mapping[str, str] = field(default_factory=dict)
    sealed: bool = field(default=False, compare=False)
    memory: Memory = field(default_factory=_new_memory, repr=False, compare=False)
    bounds: FileBounds | None = None

    @classmethod
    def read(cls, path: str | Path, bounds: FileBounds | None = None) -> Texts:
        """The score in a file and the files that it uses, with line breaks as they are.

        Later changes of the files have no effect. Raises OSError or EditError.
        """
        collector = Collector()
        file_text = decode(read_bounded(Path(path), MAX_BYTES), str(path), collector)
        if file_text is None:
            raise EditError(collector.finish()[0].message)
        return cls(str(path), file_text, bounds=bounds).complete()

    def complete(self) -> Texts:
        """These texts sealed, with every file that they use; unchanged if the score has
        mistakes.
        """
        loaded = self.load()
        if loaded.piece is None:
            return self
        files = {name: document.text for name, document in loaded.files.items()}
        files.pop(self.path, None)
        return replace(self, overlay={**files, **self.overlay}, sealed=True)

    def load(self) -> Loaded:
        """The piece that these texts describe, or their mistakes.

        The result of a sealed score without mistakes is kept.
        """
        with self.memory.lock:
            last_loaded = self.memory.last_reading
            if self.sealed and last_loaded is not None and last_loaded[0] == self:
                loaded: Loaded = last_loaded[1]
                return loaded
            loaded = load(
                self.path,
                text=self.text,
                overlay=self.overlay,
                memory=self.memory,
                bounds=self.bounds,
                sealed=self.sealed,
            )
            if self.sealed and loaded.piece is not None:
                self.memory.last_reading = self, loaded
            return loaded

    def document(self, file: str | None = None) -> Document:
        """The nodes of the score, or of another file. Raises EditError."""
        if file is None or file == self.path:
            return edit.read(self.text, self.path)
        if (text := self.overlay.get(str(Path(file)))) is not None:
            return edit.read(text, file)
        collector = Collector()
        opened_document = Files(collector, Path(file).parent).open(Path(file), None)
        if opened_document is None or collector.has_errors():
            raise EditError(collector.finish()[0].message)
        return opened_document

    def with_text(self, text: str, file: str | None = None) -> Texts:
        """These texts with a new text of the score, or of a file."""
        if file is None or file == self.path:
            return replace(self, text=text)
        return replace(self, overlay={**self.overlay, str(Path(file)): text})

    def names(self) -> tuple[Names, Uses]:
        """Every name that the score knows, with the node where it is written."""
        with self.memory.lock:
            collector = self.memory.begin(is_whole=False)
            score_folder = Path(self.path).parent
            files = Files(
                collector, score_folder, self.overlay, self.memory, self.bounds, sealed=self.sealed
            )
            uses = Uses(files, collector)
            score_text = files.text(self.path, self.text, score_folder)
            return uses.read(score_text), uses

    def edited(
        self, section: str | int, change: Callable[[Document], str], file: str | None = None
    ) -> Texts:
        """Edit the lines of one section alone, which takes a tenth of the time.

        For a missing section, edit the lines of the section above its place. If the lines cannot
        be read alone (an alias), edit the whole text.
        """
        if file is None or file == self.path:
            span = section_span(self.text, str(section))
            if span is None and section in SECTIONS:
                with contextlib.suppress(EditError):
                    if (section_text := self._text_with_section(str(section), change)) is not None:
                        return self.with_text(section_text)
            if span is not None:
                start_offset, end_offset = span
                with contextlib.suppress(EditError):
                    section_text = change(edit.read(self.text[start_offset:end_offset], self.path))
                    return self.with_text(
                        self.text[:start_offset] + section_text + self.text[end_offset:]
                    )
        return self.with_text(change(self.document(file)), file)

    def _text_with_section(
        self, section_name: str, change: Callable[[Document], str]
    ) -> str | None:
        """The text with a missing section added; None if its place is not between two sections."""
        spans = section_spans(self.text)
        section_rank = SECTIONS.index(section_name)
        indices_above = [
            line_index
            for line_index, (name, *_) in enumerate(spans[:-1])
            if name in SECTIONS[:section_rank]
        ]
        if not indices_above:
            return None
        _, start_offset, end_offset = spans[indices_above[-1]]
        next_line = f"{spans[indices_above[-1] + 1][0]}:\n"  # marks the end of the lines above
        section_text = change(edit.read(self.text[start_offset:end_offset] + next_line, self.path))
        if not section_text.endswith(next_line):
            return None
        return (
            self.text[:start_offset] + section_text.removesuffix(next_line) + self.text[end_offset:]
        )

    def edited_lists(self, list_edits: Sequence[ListEdit], file_name: str | None = None) -> Texts:
        """Edit lists of one section; only the items that change are parsed.

        If items cannot be read alone, the section is edited.
        """
        section = str(list_edits[0].path[0])
        return self._edited_alone(
            section, [(list_edit.window, list_edit.change) for list_edit in list_edits], file_name
        )

    def _edited_line(
        self, path: edit.Path, change: Callable[[Document], str], file_name: str | None
    ) -> Texts:
        """Edit the value at a path; if possible, only its line and those below it are parsed."""

        def window(text: str, section: Section) -> Window | None:
            return line_window(text, section.name, section.node, path[1:])

        def change_document(document_now: Document, _: int) -> str:
            return change(document_now)

        return self._edited_alone(str(path[0]), [(window, change_document)], file_name, path)

    def _edited_alone(
        self,
        section_name: str,
        window_edits: Sequence[tuple[_FindWindow, Change]],
        file_name: str | None,
        path: edit.Path = (),
    ) -> Texts:
        """Edit windows of one section, each parsed alone.

        An edit without a window edits the whole section; with a `path` of names, only the value at
        that path has to be parsed.
        """
        span = section_span(self.text, section_name) if file_name in (None, self.path) else None
        known_section = self._composed_section(section_name) if span is not None else None
        changes_left, edited_texts = [change for _, change in window_edits], self
        if span is not None and known_section is not None:
            section_text = self.text[slice(*span)]
            splices = [
                self._splice(section_text, known_section, *window_and_change)
                for window_and_change in window_edits
            ]
            changes_left = [
                change
                for change, splice in zip(changes_left, splices, strict=True)
                if splice is None
            ]
            section_text = apply_splices(
                section_text, [splice for splice in splices if splice is not None]
            )
            edited_texts = self.with_text(
                self.text[: span[0]] + section_text + self.text[span[1] :]
            )
        for change in changes_left:
            edit_document = partial(_changed_text, change)
            elided_texts = (
                edited_texts._edited_elided(path, edit_document)
                if path and span is not None
                else None
            )
            edited_texts = (
                edited_texts.edited(section_name, edit_document, file_name)
                if elided_texts is None
                else elided_texts
            )
        return edited_texts

    def _edited_elided(self, path: edit.Path, change: Callable[[Document], str]) -> Texts | None:
        """Edit the lines of a section without long runs of other lines; None if that cannot be."""
        span = section_span(self.text, str(path[0]))
        if (
            span is None
            or (elided_text := shorten(self.text[slice(*span)], {*map(str, path)})) is None
        ):
            return None
        with contextlib.suppress(EditError):
            restored_text = elided_text.restored(change(edit.read(elided_text.text, self.path)))
            if restored_text is not None:
                return self.with_text(self.text[: span[0]] + restored_text + self.text[span[1] :])
        return None

    def _splice(
        self, section_text: str, known_section: Section, find_window: _FindWindow, change: Change
    ) -> Splice | None:
        """The result of a change in a section's text; None if the change has no window of its
        own.
        """
        with contextlib.suppress(EditError):
            if (changed_window := find_window(section_text, known_section)) is not None:
                return changed_window.put_back(
                    change(edit.read(changed_window.text, self.path), changed_window.first_item)
                )
        return None

    def _composed_section(self, name: str) -> Section | None:
        with self.memory.lock:
            return section_composed_alone(
                self.text, self.path, Path(self.path).parent, name, self.memory
            )

    def section(self, name: str) -> Node | None:
        """The node of a section; its line numbers may be relative to the section."""
        if (section := self._composed_section(name)) is not None:
            return section.node
        read_document = self.load().files.get(self.path) if self.sealed else None
        root = (self.document() if read_document is None else read_document).root
        return root.get(name) if isinstance(root, document.Mapping) else None

    def put(self, path: edit.Path, text: str, file: str | None = None) -> Texts:
        """Set a value. Raises EditError."""
        first_list_path, first_index = _first_list(path)

        def change(document_now: Document, n_missing_items: int) -> str:
            return edit.put(document_now, _shifted(path, n_missing_items), text, SECTIONS)

        if first_index is None:
            return self._edited_line(path, lambda document_now: change(document_now, 0), file)
        return self.edited_lists([ListEdit(first_list_path, first_index, change)], file)

    def append(self, path: edit.Path, text: str) -> Texts:
        """Add an item to a list. Raises EditError."""

        def change(document_now: Document, _: int) -> str:
            return edit.append(document_now, path, text, SECTIONS)

        return self.edited_lists([ListEdit(path, None, change)])

    def remove(self, *paths: edit.Path, file: str | None = None) -> Texts:
        """Remove entries or items of one parent. Raises EditError."""
        # Removing a section changes more than its own lines.
        if min(len(path) for path in paths) == 1:
            return self.with_text(edit.remove(self.document(file), *paths), file)
        list_paths = [_first_list(path) for path in paths]
        first_indices = [first_index for _, first_index in list_paths if first_index is not None]
        if len(first_indices) < len(list_paths):
            return self._edited_line(
                paths[0], lambda document_now: edit.remove(document_now, *paths), file
            )

        def change(document_now: Document, n_missing_items: int) -> str:
            return edit.remove(document_now, *(_shifted(path, n_missing_items) for path in paths))

        # Include the item before the first one that is removed, so that the list never becomes
        # empty.
        return self.edited_lists([ListEdit(list_paths[0][0], min(first_indices) - 1, change)], file)


def _changed_text(change: Change, document_now: Document) -> str:
    return change(document_now, 0)


def _first_list(path: edit.Path) -> tuple[edit.Path, int | None]:
    """The path of the first list on a path, and the item's index; None if there is no list."""
    for index, name in enumerate(path):
        if isinstance(name, int):
            return path[:index], name
    return path, None


def _shifted(path: edit.Path, n_missing_items: int) -> edit.Path:
    """A path in a document that lacks the first `n_missing_items` items of its first list."""
    list_path, first_index = _first_list(path)
    return (
        path
        if first_index is None
        else (*list_path, first_index - n_missing_items, *path[len(list_path) + 1 :])
    )
