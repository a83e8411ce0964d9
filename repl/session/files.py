"""What a session writes: its score as it stands, and what was changed of the files that it uses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.exchange.safe import FileRefusedError
from ergon.exchange.together import write_all
from ergon.notation.text.files import is_shipped
from ergon.repl.session import apart
from ergon.repl.session.disk import as_written, home
from ergon.repl.session.version import NotTakenError, piece_of
from ergon.scores.edits import keeping, parts
from ergon.scores.edits.texts import Texts

if TYPE_CHECKING:
    from ergon.notation.clock.positions import Length
    from ergon.repl.session.session import Session

_SUFFIXES = (".yaml", ".yml")


class Watch:
    """Whether the score, or a file that it uses, was saved by somebody else."""

    def __init__(self, texts: Texts) -> None:
        """From now on."""
        self._files = [Path(name) for name in texts.load().files]
        self._seen = self._stamps()

    def has_changed(self) -> bool:
        """Whether one was saved since the last look."""
        now = self._stamps()
        changed, self._seen = now != self._seen, now
        return changed

    def _stamps(self) -> list[int]:
        return [_stamp(path) for path in self._files]


def _stamp(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:  # an editor puts a new file in its place
        return 0


def keep(session: Session, length: Length, name: str) -> list[str]:
    """Write the last bars as a score of their own beside this one; the files that were written."""
    version, now = session.commits.head, session.commits.now()
    tempo = version.piece.tempo_map
    beats = tempo.after(0.0, length) if not length.seconds else None
    start = now - beats if beats is not None else tempo.beats(tempo.seconds(now) - length.seconds)
    kept = keeping.keep(version.texts, version.piece, name, max(0.0, start), now)
    piece_of(kept)
    target = _target(kept, Path(name))
    if target is None:
        raise NotTakenError(f"{name} is the score itself: give what is kept another name")
    return _write(session, kept, target)


def save(session: Session, target: Path | None) -> list[str]:
    """Write the score of the latest version, what goes on ended here; the files that were written.

    Without a target over its own file, and over those that it uses, where they were changed.
    """
    version = session.commits.head
    texts = parts.finish(version.texts, version.piece, session.commits.now())
    piece_of(texts)
    return _write(session, texts, None if target is None else _target(texts, target))


def folder_of(texts: Texts) -> Path:
    """Where what a session makes of a score is written; of one that ships, where we are."""
    path = Path(texts.path)
    return Path() if is_shipped(path) else path.parent


def _target(texts: Texts, target: Path) -> Path | None:
    """Where a name leads; None where it is the score itself. Raises NotTakenError."""
    own, folder = Path(texts.path), folder_of(texts)
    path = folder / target if target.parent == Path() else target
    if path.suffix == "":
        path = path.with_suffix(own.suffix if own.suffix in _SUFFIXES else _SUFFIXES[0])
    try:
        real, is_inside = path.resolve(), path.resolve().parent == folder.resolve()
        is_own = real == own.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a circle of links, or no name at all
        raise NotTakenError(f"{str(path)!a} cannot be written: {error}") from None
    if not is_inside:
        raise NotTakenError(
            f"the files that it uses are named from {folder.resolve()}: save it there",
            f"save {path.name}",
        )
    return None if is_own else folder / path.name


def _write(session: Session, texts: Texts, target: Path | None) -> list[str]:
    """Write texts over their files, or as another score; nothing at all where one is refused."""
    own, disk = Path(texts.path), session.disk
    changed = disk.changed(texts)
    files: Mapping[str, str]
    if target is None:
        if texts.path not in disk.hashes():
            raise NotTakenError(f"{own} was never read here: `save NAME` writes a file beside it")
        score, files = own, {home(file, own.parent): text for file, text in changed.items()}
    else:
        score, files = target, apart.files(texts, changed.keys() - {texts.path}, target)
    if not files:
        return []
    _proven(texts, changed, score, files)
    try:
        write_all(
            {Path(file): as_written(file, text) for file, text in files.items()},
            lambda path: disk.check(str(path), score),
        )
    except (FileRefusedError, OSError) as error:
        raise NotTakenError(str(error)) from None
    disk.wrote(files)
    session.wrote(texts)
    return [*files]


def _proven(
    texts: Texts, changed: Mapping[str, str], score: Path, files: Mapping[str, str]
) -> None:
    """Whether what will lie on the disk is what plays. Raises NotTakenError."""
    left = {file: text for file, text in texts.overlay.items() if file not in changed}
    text = files.get(str(score), texts.text)
    there = Texts(str(score), text, {**left, **files}, sealed=True).load().piece
    if there is None or there.digest() != piece_of(texts).digest():
        names = ", ".join(sorted(Path(file).name for file in changed))
        raise NotTakenError(
            f"{names}: what was changed cannot stand beside {score.name}; `save` writes it in place"
        )
