"""A score with all its files as plain data, for a process that may run on another machine.

Files keep their places relative to each other, below a folder of their own; no other file of
this machine can be named there.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, TypedDict

from ergon.common.errors import ErgonError
from ergon.common.regular import read_bounded
from ergon.notation.text.bounds import MARKER

from . import score as scores

if TYPE_CHECKING:
    from ergon.scores.reading.load import Loaded

_BYTES_MAX = 256_000_000  # all files together: hours of takes


class ScoreBundle(TypedDict):
    """A score: its path and the contents of all files, by their paths below one folder."""

    score: str
    root: str  # that folder on this machine, for messages
    files: dict[str, bytes]


class NotBundledError(ErgonError):
    """The score and its files cannot be computed in another process."""


def bundle_score(path: str, loaded: Loaded) -> ScoreBundle:
    """A score that was read, with its files. Raises NotBundledError and OSError."""
    scores.piece_of(loaded)
    texts = {_absolute_path(name): document.text for name, document in loaded.files.items()}
    content_by_path = {file_path: text.encode() for file_path, text in texts.items()}
    n_bytes_left = _BYTES_MAX - sum(map(len, content_by_path.values()))
    for input_path in loaded.inputs:
        absolute_path = _absolute_path(str(input_path))
        if absolute_path not in content_by_path and n_bytes_left >= 0:
            content_by_path[absolute_path] = read_bounded(Path(absolute_path), n_bytes_left)
            n_bytes_left -= len(content_by_path[absolute_path])
    if n_bytes_left < 0:
        raise NotBundledError(
            f"{path} and its files have more than {_BYTES_MAX // 1_000_000} MB, which is the most "
            "that goes to another process"
        )
    common_folder = os.path.commonpath(
        [os.path.dirname(file_path) for file_path in content_by_path]
    )
    name_by_path = {
        file_path: Path(os.path.relpath(file_path, common_folder)).as_posix()
        for file_path in content_by_path
    }
    files = {name_by_path[file_path]: content for file_path, content in content_by_path.items()}
    return ScoreBundle(score=name_by_path[_absolute_path(path)], root=common_folder, files=files)


def digest(bundle: ScoreBundle, *details: object) -> str:
    """A hash of a score, its files and `details`, which say what is done with them (64 hex
    digits).
    """
    combined_hash = hashlib.sha256(repr((bundle["score"], *details)).encode())
    for name, file_bytes in sorted(bundle["files"].items()):
        combined_hash.update(f"\0{len(file_bytes)} {name}\0".encode())
        combined_hash.update(file_bytes)
    return combined_hash.hexdigest()


@contextmanager
def unpack(bundle: ScoreBundle) -> Iterator[Path]:
    """Unpack a score into a temporary folder; gives the path of the score in it.

    Raises NotBundledError if a name would lead out of that folder.
    """
    with tempfile.TemporaryDirectory(prefix="ergon-") as folder_name:
        folder = Path(os.path.realpath(folder_name))
        (folder / MARKER).touch()  # all below is one project
        for file_name, file_data in bundle["files"].items():
            file_place = PurePosixPath(file_name)
            if (
                file_place.is_absolute()
                or ".." in file_place.parts
                or "\\" in file_name
                or ":" in file_name
            ):
                raise NotBundledError(f"'{file_name}' is not a file of this score")
            path = folder.joinpath(*file_place.parts)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(file_data)
        if bundle["score"] not in bundle["files"]:
            raise NotBundledError("the score is not among its files")
        yield folder / bundle["score"]


def with_local_paths(sentence: str, path: Path, bundle: ScoreBundle) -> str:
    """A sentence of the other process, with the names that files have on this machine."""
    unpacked_root = str(path)[: -len(bundle["score"])].rstrip("/")
    return sentence.replace(unpacked_root, bundle["root"].rstrip("/"))


def _absolute_path(name: str) -> str:
    return os.path.abspath("stdin.yaml" if name == scores.STDIN else name)
