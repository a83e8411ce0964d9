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
    texts = {_place_in_bundle(name): document.text for name, document in loaded.files.items()}
    bytes_by_place = {place: text.encode() for place, text in texts.items()}
    n_bytes_max = _BYTES_MAX - sum(map(len, bytes_by_place.values()))
    for input_path in loaded.inputs:
        file_place = _place_in_bundle(str(input_path))
        if file_place not in bytes_by_place and n_bytes_max >= 0:
            bytes_by_place[file_place] = read_bounded(Path(file_place), n_bytes_max)
            n_bytes_max -= len(bytes_by_place[file_place])
    if n_bytes_max < 0:
        raise NotBundledError(
            f"{path} and its files have more than {_BYTES_MAX // 1_000_000} MB, which is the most "
            "that goes to another process"
        )
    common_folder = os.path.commonpath([os.path.dirname(place) for place in bytes_by_place])
    name_by_place = {
        place: Path(os.path.relpath(place, common_folder)).as_posix() for place in bytes_by_place
    }
    files = {name_by_place[place]: content for place, content in bytes_by_place.items()}
    return ScoreBundle(score=name_by_place[_place_in_bundle(path)], root=common_folder, files=files)


def digest(content: ScoreBundle, *details: object) -> str:
    """A hash of a score, its files and `details`, which say what is done with them (64 hex
    digits).
    """
    combined_hash = hashlib.sha256(repr((content["score"], *details)).encode())
    for name, file_bytes in sorted(content["files"].items()):
        combined_hash.update(f"\0{len(file_bytes)} {name}\0".encode())
        combined_hash.update(file_bytes)
    return combined_hash.hexdigest()


@contextmanager
def unpack(content: ScoreBundle) -> Iterator[Path]:
    """Unpack a score into a temporary folder; gives the path of the score in it.

    Raises NotBundledError if a name would lead out of that folder.
    """
    with tempfile.TemporaryDirectory(prefix="ergon-") as folder_name:
        folder = Path(os.path.realpath(folder_name))
        (folder / MARKER).touch()  # all below is one project
        for file_name, file_data in content["files"].items():
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
        if content["score"] not in content["files"]:
            raise NotBundledError("the score is not among its files")
        yield folder / content["score"]


def with_local_paths(sentence: str, path: Path, content: ScoreBundle) -> str:
    """A sentence of the other process, with the names that files have on this machine."""
    unpacked_root = str(path)[: -len(content["score"])].rstrip("/")
    return sentence.replace(unpacked_root, content["root"].rstrip("/"))


def _place_in_bundle(name: str) -> str:
    return os.path.abspath("stdin.yaml" if name == scores.STDIN else name)
