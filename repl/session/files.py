"""Saving: the score of a version, and those files it uses that have changed."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.exchange.safe import FileRefusedError, write_all
from ergon.notation.text.edit import EditError
from ergon.repl.language.scope import SCORE_SUFFIXES
from ergon.repl.session import save_as
from ergon.repl.session.disk import file_bytes, folder_of, target_path
from ergon.repl.session.version import NotTakenError, piece_of
from ergon.scores.edits import excerpt, parts
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.digest import digest_of
from ergon.scores.staging.automating import value_on_beat

if TYPE_CHECKING:
    from ergon.notation.clock.positions import Length
    from ergon.repl.session.core import SessionCore


def write_last_bars(session: SessionCore, excerpt_length: Length, file_name: str) -> list[str]:
    """Write the last bars as a score beside this one; the names of the written files."""
    version, beat_now = session.schedule.head, session.schedule.beat_now()
    tempo_map = version.piece.tempo_map
    bar_start = tempo_map.bars.start(tempo_map.bar_beat(beat_now)[0])
    is_in_bars = excerpt_length.bars and not excerpt_length.beats and not excerpt_length.seconds
    end_beats = (
        [bar_start, beat_now] if is_in_bars and bar_start > 0.0 else [beat_now]
    )  # whole bars are those that are over
    while True:
        stop_beat = end_beats.pop(0)
        start_beat = tempo_map.beats(tempo_map.seconds(stop_beat) - excerpt_length.seconds)
        if not excerpt_length.seconds:
            start_beat = stop_beat - tempo_map.after(0.0, excerpt_length)
        try:
            excerpt_texts = excerpt.excerpt_between(
                version.texts,
                version.piece,
                file_name,
                max(0.0, start_beat),
                stop_beat,
                value_on_beat,
            )
            break
        except EditError:
            if not end_beats:
                raise
    piece_of(excerpt_texts)
    target = _save_target(excerpt_texts, Path(file_name))
    if target is None:
        raise NotTakenError(
            f"{file_name} is this score's own name: choose another name for the bars that are kept"
        )
    return _write_texts(session, excerpt_texts, target)


def save_version(session: SessionCore, target: Path | None) -> list[str]:
    """Write the latest version, with endless parts ended here; the names of the written files.

    Without a target, the score and the changed files that it uses are overwritten.
    """
    version = session.schedule.head
    texts = parts.end_endless(version.texts, version.piece, session.schedule.beat_now())
    piece_of(texts)
    return _write_texts(session, texts, None if target is None else _save_target(texts, target))


def new_file_beside(score_texts: Texts, target: Path, suffix: str) -> Path:
    """A new file in the folder that a session writes to. Raises NotTakenError."""
    path = _with_suffix(score_texts, target, suffix)
    if path.suffix.lower() != suffix:
        raise NotTakenError(
            f"{path.name} does not end in {suffix}", f"record audio {path.stem}{suffix}"
        )
    folder = folder_of(score_texts)
    if _resolved_path(path).parent != folder.resolve():
        raise NotTakenError(
            f"a session writes only into {folder.resolve()}", f"record audio {path.name}"
        )
    return folder / path.name


def _save_target(score_texts: Texts, target: Path) -> Path | None:
    """The file for a name; None if that is the score itself. Raises NotTakenError."""
    score_path, folder = Path(score_texts.path), folder_of(score_texts)
    suffix = score_path.suffix if score_path.suffix in SCORE_SUFFIXES else SCORE_SUFFIXES[0]
    path = _with_suffix(score_texts, target, suffix)
    real_path = _resolved_path(path)
    if real_path.parent != folder.resolve():
        raise NotTakenError(
            f"save the score in {folder.resolve()}: the paths in it are relative to that folder",
            f"save {path.name}",
        )
    return None if real_path == _resolved_path(score_path) else folder / path.name


def _with_suffix(score_texts: Texts, target: Path, suffix: str) -> Path:
    """A file as it was named, beside the score if no folder was named. Raises NotTakenError."""
    if target.name in ("", ".."):
        raise NotTakenError(f"{target} is a folder: name a file")
    path = folder_of(score_texts) / target if target.parent == Path() else target
    return path if path.suffix else path.with_suffix(suffix)


def _resolved_path(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a circle of links, or an impossible name
        raise NotTakenError(f"{str(path)!a} cannot be written: {error}") from None


def _write_texts(session: SessionCore, score_texts: Texts, target: Path | None) -> list[str]:
    """Write texts over their files, or as another score; either all files are written or none."""
    score_path, disk = Path(score_texts.path), session.disk
    changed_texts = disk.unsaved_texts(score_texts)
    texts_by_file: Mapping[str, str]
    if target is None:
        # A piece that was typed from nothing has no file yet.
        if score_texts.path not in disk.hashes() and os.path.lexists(score_path):
            raise NotTakenError(
                f"this session has not read {score_path}: `save NAME` writes a file beside it"
            )
        score_file = score_path
        texts_by_file = {
            target_path(file, score_path.parent): text for file, text in changed_texts.items()
        }
    else:
        score_file = target
        texts_by_file = save_as.texts_to_write(
            score_texts, changed_texts.keys() - {score_texts.path}, target
        )
    if not texts_by_file:
        return []
    _check_written(score_texts, changed_texts, score_file, texts_by_file)
    try:
        write_all(
            {Path(file): file_bytes(file, text) for file, text in texts_by_file.items()},
            lambda path: disk.check_writable(str(path), score_file),
        )
    except (FileRefusedError, OSError) as error:
        raise NotTakenError(str(error)) from None
    disk.note_written(texts_by_file)
    session.note_written(score_texts, is_own=target is None)
    return [*texts_by_file]


def _check_written(
    score_texts: Texts,
    changed_texts: Mapping[str, str],
    score_file: Path,
    texts_by_file: Mapping[str, str],
) -> None:
    """Check that the written files give the piece that plays. Raises NotTakenError."""
    unchanged_texts = {
        file: text for file, text in score_texts.overlay.items() if file not in changed_texts
    }
    text = texts_by_file.get(str(score_file), score_texts.text)
    written_piece = (
        Texts(str(score_file), text, {**unchanged_texts, **texts_by_file}, sealed=True).load().piece
    )
    if written_piece is None or digest_of(written_piece) != digest_of(piece_of(score_texts)):
        names = ", ".join(sorted(Path(file).name for file in changed_texts))
        raise NotTakenError(
            f"the changes to {names} would be lost in {score_file.name}; `save` without a name "
            "writes them to their own files"
        )
