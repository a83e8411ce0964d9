"""Scores with all that they read in one file: made, opened, and unpacked."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.regular import read_bounded
from ergon.common.report import Report
from ergon.common.shown_paths import show_as
from ergon.exchange.pack import (
    BYTES_MAX,
    SUFFIX,
    Pack,
    PackError,
    pack_bytes,
    read_pack,
    write_files,
)
from ergon.scores.reading.digest import digest_of

from . import score as scores
from .errors import OptionError
from .options import ReadOptions

if TYPE_CHECKING:
    from ergon.scores.reading.load import Loaded


@dataclass(frozen=True, slots=True)
class PackedFile:
    """A pack that was written, and its size in bytes."""

    path: str
    pack: Pack
    size: int


def pack(
    score: str | Path,
    out: str | Path | None = None,
    options: ReadOptions | None = None,
    *,
    force: bool = False,
    report: Report | None = None,
) -> PackedFile:
    """Write a score, and all files that it reads, into one file; "-" is stdout.

    Files of the library that the score uses are packed too, so a later library does not change the
    piece. The pack is read again before it is written. Raises ScoreError, PackError, OptionError
    and FileRefusedError.
    """
    from ergon.exchange.safe import open_for_writing

    if out is None and str(score) == scores.STDIN:
        raise OptionError("output", "a score from stdin has no name for the pack; name one")
    target_path = str(out) if out is not None else f"{Path(score).stem}{SUFFIX}"
    loaded = scores.read(score, options, report)
    packed_files = _packed_files(str(score), loaded)
    encoded_pack = pack_bytes(packed_files)
    _check_same_piece(packed_files, loaded)
    with open_for_writing(target_path, binary=True, force=force, inputs=loaded.inputs) as file:
        file.write(encoded_pack)
    return PackedFile(target_path, packed_files, len(encoded_pack))


@contextmanager
def opened_pack(path: str | Path) -> Iterator[Path]:
    """The score of a pack, in a private folder for the time of the block.

    Messages name its files `PACK:FILE`. Raises PackError and OSError.
    """
    with _unpacked_score(read_pack(Path(path)), str(path)) as score:
        yield score


def unpack(path: str | Path, folder: str | Path | None = None) -> Path:
    """Write the files of a pack into a new folder, by default PACK here; the path of the score.

    Raises PackError, OSError and FileRefusedError.
    """
    from ergon.exchange.new_folder import new_folder

    pack = read_pack(Path(path))
    target_folder = Path(folder) if folder is not None else Path(Path(path).stem)
    with new_folder(target_folder) as part_folder:
        write_files(pack, part_folder)
        (part_folder / _marker_name()).touch()
    return target_folder / pack.score


def _packed_files(score: str, loaded: Loaded) -> Pack:
    """The files of a score, in their places relative to each other; those that ship are beside the
    score, where they take precedence.
    """
    from ergon._core import __version__
    from ergon.notation.text.files import shipped

    scores.piece_of(loaded)
    score_place = _place_in_folder(score)
    files_by_name: dict[str, bytes] = {}
    n_bytes_max = BYTES_MAX
    for input_name in dict.fromkeys(map(str, loaded.inputs)):
        library_file = shipped(Path(input_name))
        packed_name = (
            _place_in_folder(input_name)
            if library_file is None
            else os.path.join(os.path.dirname(score_place), library_file)
        )
        is_stdin = input_name == scores.STDIN
        packed_bytes = (
            loaded.files[input_name].text.encode()
            if is_stdin
            else read_bounded(Path(input_name), n_bytes_max)
        )
        if files_by_name.setdefault(packed_name, packed_bytes) != packed_bytes:
            raise PackError(
                f"{packed_name} and the file {library_file} of the library would be one file in "
                "a pack; "
                "rename your own"
            )
        n_bytes_max = max(0, n_bytes_max - len(packed_bytes))
    common_folder = os.path.commonpath([os.path.dirname(path) for path in files_by_name])
    name_by_path = {
        path: Path(os.path.relpath(path, common_folder)).as_posix() for path in files_by_name
    }
    return Pack(
        name_by_path[score_place],
        __version__,
        {name_by_path[path]: files_by_name[path] for path in files_by_name},
    )


def _check_same_piece(pack: Pack, loaded: Loaded) -> None:
    """Raise PackError unless a pack holds all that makes its piece."""
    from ergon.scores.reading.load import load

    with _unpacked_score(pack) as score_path:
        loaded_again = load(score_path)
        folder_prefix = os.path.realpath(score_path)[: -len(pack.score)]
        for path in loaded_again.inputs:
            if not os.path.realpath(path).startswith(folder_prefix):
                raise PackError(f"{path} would be read from outside the pack")
        if loaded_again.piece is None:
            first_error = next(
                diagnostic
                for diagnostic in loaded_again.diagnostics
                if diagnostic.severity == "error"
            )
            line_number = first_error.place.line
            raise PackError(
                f"{pack.score}:{line_number}: {first_error.message}; in a pack files are named "
                "relative to the file that names them"
            )
        if digest_of(loaded_again.piece) != digest_of(scores.piece_of(loaded)):
            raise PackError("the pack would be another piece: a file changed while it was packed")


@contextmanager
def _unpacked_score(pack: Pack, pack_name: str | None = None) -> Iterator[Path]:
    """The score of a pack in a private folder; messages name its files as those of `pack_name`."""
    with tempfile.TemporaryDirectory(prefix="ergon-pack-") as folder_name:
        folder = Path(os.path.realpath(folder_name))
        if pack_name is not None:
            show_as(folder, pack_name)
        (folder / _marker_name()).touch()  # all below is one project
        yield write_files(pack, folder)


def _marker_name() -> str:
    from ergon.notation.text.bounds import MARKER

    return MARKER


def _place_in_folder(name: str) -> str:
    return os.path.abspath("stdin.yaml" if name == scores.STDIN else name)
