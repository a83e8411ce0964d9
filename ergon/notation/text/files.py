"""Files of a score: found beside the file that names them or in the library, read once.

`Files.locate` alone decides which file a name of a score stands for, and whether it may.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from itertools import islice
from pathlib import Path, PurePosixPath

from ergon.common.regular import read_bounded
from ergon.notation.text.bounds import SHIPPED_INSTRUMENTS_FOLDER, SHIPPED_SCORES_FOLDER, FileBounds
from ergon.notation.text.document import Document, compose
from ergon.notation.text.errors import Collector
from ergon.notation.text.memory import Memory
from ergon.notation.text.sections import compose_with_memory
from ergon.notation.text.spelling import nearest
from ergon.notation.text.syntax import MAX_BYTES, Decoder, decode
from ergon.notation.text.values import Place

MAX_FILES = 256  # files that one score may read
MAX_LISTED = 1_000  # files of a folder among which a similar name is searched for
_LIBRARY = {"instruments": SHIPPED_INSTRUMENTS_FOLDER}
_MAX_TOLD = 6  # files that a message lists
_NAMES_MAX = 200  # files of a folder that a misspelt name is compared with
_HELP = "copy the file into the folder of the score, or use --trust"


def is_file(path: Path) -> bool:
    """Whether a path is a regular file; False for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def shipped(path: Path) -> str | None:
    """The name by which scores use a file that ships; None for any other file."""
    for prefix, root in (*_LIBRARY.items(), ("", SHIPPED_SCORES_FOLDER)):
        if path.is_relative_to(root):
            return str(PurePosixPath(prefix, path.relative_to(root).as_posix()))
    return None


def installed_path(library_name: str) -> Path:
    """Where a file that ships is installed, by the name by which scores use it."""
    first_part, *other_parts = PurePosixPath(library_name).parts
    root = _LIBRARY.get(first_part)
    return SHIPPED_SCORES_FOLDER / library_name if root is None else root.joinpath(*other_parts)


def is_shipped(path: Path) -> bool:
    """Whether a file is, or would be, in the installed library, by whatever name and link."""
    real_path = os.path.realpath(path)
    roots = (os.path.realpath(root) for root in (*_LIBRARY.values(), SHIPPED_SCORES_FOLDER))
    return any(real_path == root or real_path.startswith(root + os.sep) for root in roots)


def is_below(path: Path, folder: Path) -> bool:
    """Whether a file is, or would be, in a folder or below it, with all links followed."""
    real_path, root = os.path.realpath(path), os.path.realpath(folder)
    return real_path.startswith(root.rstrip(os.sep) + os.sep)


class Files:
    """Reads YAML files; `overlay` holds texts that replace files (from an editor or a test).

    If `sealed`, texts are read only from `overlay` and from the files that ship.

    A file in `home`, the score's folder, replaces the file that ships under the same name, also
    where a file of the library names it: a changed copy takes precedence.
    """

    def __init__(
        self,
        collector: Collector,
        home: Path,
        overlay: Mapping[str, str] | None = None,
        memory: Memory | None = None,
        bounds: FileBounds | None = None,
        *,
        sealed: bool = False,
    ) -> None:
        """Start with nothing read except what `memory` holds; `bounds` default to those of
        `home`.
        """
        self.collector = collector
        self.memory = memory
        self.documents: dict[str, Document] = {}
        self.home = home
        self._bounds = bounds
        self._overlay = {str(Path(name)): text for name, text in (overlay or {}).items()}
        self._sealed = sealed

    @property
    def bounds(self) -> FileBounds:
        """Where the files that a score names must lie; found when a file is looked for."""
        if self._bounds is None:
            self._bounds = FileBounds.around(self.home)
        return self._bounds

    def find(self, name: str, folder: Path, *, is_text: bool = True) -> Path | None:
        """A file relative to a folder or to `home`, or one that ships; None if there is none.

        The file found may lie outside the bounds. A file that is not text (a take) is never in
        the overlay.
        """
        for path in self._candidates(name, folder):
            if self._holds(path):
                return path
            if self._sealed and is_text and shipped(path) is None:
                continue
            if not self.bounds.allows(path) or is_file(path):
                return path
        return None

    def _candidates(self, file_name: str, folder: Path) -> list[Path]:
        paths = [folder / file_name]
        path_parts = PurePosixPath(file_name).parts
        if path_parts and ".." not in path_parts and not Path(file_name).is_absolute():
            if folder != self.home:
                paths.append(self.home / file_name)
            if path_parts[0] in _LIBRARY and len(path_parts) > 1:
                paths.append(_LIBRARY[path_parts[0]].joinpath(*path_parts[1:]))
            paths.append(SHIPPED_SCORES_FOLDER / file_name)
        return paths

    def _holds(self, path: Path) -> bool:
        return str(path) in self._overlay

    def locate(
        self, name: str, folder: Path, asking_place: Place, label: str = "", *, is_text: bool = True
    ) -> Path | None:
        """The file that a name in a file of `folder` stands for; None after a report."""
        path = self.find(name, folder, is_text=is_text)
        if path is None:
            message = f"{label}there is no file {name} beside {asking_place.file} or in the library"
            self.collector.error(
                "E107",
                message,
                asking_place,
                suggestion=_similar(name, folder),
                help=_library_list(name),
            )
            return None
        return path if self._is_inside(path, name, asking_place, label) else None

    def target(self, name: str, folder: Path, asking_place: Place, label: str = "") -> Path | None:
        """The path of a file that a score asks to write; None after a report."""
        path = folder / name
        help = "write into the folder of the score, or use --trust"
        return path if self._is_inside(path, name, asking_place, label, help) else None

    def _is_inside(
        self, path: Path, name: str, asking_place: Place, label: str, help: str = _HELP
    ) -> bool:
        is_inside = self._holds(path) or self.bounds.allows(path)
        if not is_inside:
            message = f"{label}{name} lies outside the score's folder"
            self.collector.error("E112", message, asking_place, help=help)
        return is_inside

    def text(self, name: str, text: str, folder: Path) -> Document:
        """A document from a text that is at hand."""
        self.collector.file(name)
        text = text.removeprefix("\ufeff")
        if self.memory is not None:
            document = compose_with_memory(text, name, folder, self.collector, self.memory)
        else:
            document = compose(text, name, self.collector)
        document.folder = folder
        self.documents[name] = document
        return document

    def open(self, path: Path, asking_place: Place | None) -> Document | None:
        """A document from a file; None after a report at the place that asked for it."""
        path_name = str(path)
        if path_name in self.documents:
            return self.documents[path_name]
        if len(self.documents) >= MAX_FILES:
            self._refuse(
                "E105", f"the score uses more than {MAX_FILES} files", path_name, asking_place
            )
            return None
        if path_name in self._overlay:
            return self.text(path_name, self._overlay[path_name], path.parent)
        try:
            file_data = read_bounded(path, MAX_BYTES)
        except OSError as error:
            failure_reason = error.strerror or type(error).__name__
            help = _advice(path) if asking_place is None else None
            self._refuse(
                "E107",
                f"{path_name} cannot be read: {failure_reason}",
                path_name,
                asking_place,
                help,
            )
            return None
        self.collector.file(path_name)
        file_text = decode(file_data, path_name, self.collector)
        if file_text is None:
            self.documents[path_name] = Document(path_name, "")
            return None
        return self.text(path_name, file_text, path.parent)

    def required(
        self, file_name: str, folder: Path, asking_place: Place, *, may_be_empty: bool = False
    ) -> Document | None:
        """The document that a file names; None after a report."""
        path = self.locate(file_name, folder, asking_place)
        if path is None:
            return None
        is_new, n_reports = str(path) not in self.documents, self.collector.n_reports
        document = self.open(path, asking_place)
        if document is None or document.root is not None:
            return document
        if is_new and self.collector.n_reports == n_reports:  # nothing in it was refused
            if may_be_empty:
                return document
            self._refuse("E103", f"{file_name} is empty", str(path), asking_place)
        return None

    def plain(
        self,
        name: str,
        folder: Path,
        asking_place: Place,
        decoder: Decoder = decode,
    ) -> Document | None:
        """A text that is not YAML, such as a table; None after a report.

        `decoder` (bytes, name, collector) turns the bytes of the file into a text, or reports.
        """
        path = self.locate(name, folder, asking_place)
        if path is None or str(path) in self.documents:
            return None if path is None else self.documents[str(path)]
        plain_text: str | None = self._overlay.get(str(path))
        if plain_text is None:
            try:
                file_data = read_bounded(path, MAX_BYTES)
            except OSError as error:
                reason = error.strerror or type(error).__name__
                self._refuse("E107", f"{path} cannot be read: {reason}", str(path), asking_place)
                return None
            self.collector.file(str(path))
            plain_text = decoder(file_data, str(path), self.collector)
        document = Document(str(path), plain_text or "")
        self.documents[str(path)] = document
        return document if plain_text is not None else None

    def _refuse(
        self,
        code: str,
        message: str,
        name: str,
        asking_place: Place | None,
        help: str | None = None,
    ) -> None:
        self.collector.error(code, message, asking_place or Place(name, 1, 1), help=help)


def _advice(path: Path) -> str:
    """What to do about a score that cannot be read: another file, or a score that ships."""
    if path.suffix in (".wav", ".flac"):
        return f"the sound that is to be written is named by -o: -o {path}"
    if path.parts[:1] in (("http:",), ("https:",)):
        return "files of this machine are read: download it first, then name the file"
    if "*" in path.name:
        return "no file has such a name; without quotes a shell puts names in its place"
    folder = path if path.is_dir() else path.parent
    names = [file.name for pattern in ("*.yaml", "*.yml") for file in sorted(folder.glob(pattern))]
    names = names[:_NAMES_MAX]
    suggestion = names[0] if path.is_dir() and names else nearest(path.name, names)
    if suggestion:
        return f"did you mean {folder / suggestion}?"
    return "`ergon new NAME` makes a score, `ergon demo --list` names those that ship"


def _similar(file_name: str, folder: Path) -> str | None:
    """The file beside the score, or in the library, that a name was most likely meant for."""
    paths_by_name: dict[str, str] = {}
    library_folder = _library_folder(file_name)
    for prefix in (library_folder,) if library_folder else _LIBRARY if _is_yaml(file_name) else ():
        paths = sorted(installed_path(prefix).glob("*.yaml"))
        paths_by_name |= {path.stem: f"{prefix}/{path.name}" for path in paths}
    for subfolder in (PurePosixPath(), PurePosixPath(file_name).parent):
        if subfolder.is_absolute() or ".." in subfolder.parts:
            continue
        try:
            with os.scandir(folder / subfolder) as entries:
                files = [entry.name for entry in islice(entries, MAX_LISTED) if entry.is_file()]
        except (OSError, ValueError):
            continue
        similar_files = [file for file in sorted(files) if _is_yaml(file) == _is_yaml(file_name)]
        paths_by_name |= {PurePosixPath(file).stem: str(subfolder / file) for file in similar_files}
    stem = nearest(PurePosixPath(file_name).stem, paths_by_name)
    return paths_by_name[stem] if stem is not None else None


def _is_yaml(name: str) -> bool:
    return PurePosixPath(name).suffix.lower() in ("", ".yaml", ".yml")


def _library_folder(name: str) -> str | None:
    """The folder of the library, such as `layouts`, in which a name is looked for."""
    prefix, *path_rest = PurePosixPath(name).parts or ("",)
    is_plain = len(path_rest) == 1 and prefix not in ("", ".", "..", "/")
    return prefix if is_plain and installed_path(prefix).is_dir() else None


def _library_list(library_name: str) -> str | None:
    """The files of a folder of the library as one line of help; None if there are none or too
    many.
    """
    prefix = _library_folder(library_name)
    files = sorted(installed_path(prefix).glob("*.yaml")) if prefix else []
    if not 0 < len(files) <= _MAX_TOLD:
        return None
    return f"in the library: {', '.join(f'{prefix}/{path.name}' for path in files)}"
