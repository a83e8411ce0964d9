"""What a session writes: its score as it stands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ergon.exchange.safe import RefusedError, write_text
from ergon.repl.session.edits import keeping, parts
from ergon.repl.session.version import NotTakenError, piece_of

if TYPE_CHECKING:
    from ergon.repl.session.session import Session
    from ergon.repl.session.texts import Texts
    from ergon.scores.clock.positions import Length


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


def keep(session: Session, length: Length, name: str) -> str:
    """Write the last bars as a score of their own beside this one; the file that was written."""
    version, now = session.commits.head, session.commits.now()
    tempo = version.piece.tempo_map
    beats = tempo.after(0.0, length) if not length.seconds else None
    start = now - beats if beats is not None else tempo.beats(tempo.seconds(now) - length.seconds)
    kept = keeping.keep(version.texts, version.piece, name, max(0.0, start), now)
    piece_of(kept)
    path = Path(version.texts.path).with_name(f"{name}.yaml")
    try:
        write_text(path, kept.text)
    except (RefusedError, OSError) as error:
        raise NotTakenError(str(error).removesuffix(" (-f overwrites it)")) from None
    return str(path)


def save(session: Session, target: Path | None) -> list[str]:
    """Write the score of the latest version, what goes on ended here; the files that were written.

    Without a target over its own file, and files that it uses beside it where they were changed.
    """
    version = session.commits.head
    texts = parts.finish(version.texts, version.piece, session.commits.now())
    piece_of(texts)
    own = Path(texts.path)
    path = own if target is None else target
    if path.parent == Path():  # a mere name
        path = own.parent / path
    if path.suffix == "":
        path = path.with_suffix(own.suffix)
    if path.resolve().parent != own.resolve().parent:
        raise NotTakenError(
            f"the files that it uses are named from {own.parent}: save it there",
            f"save {own.parent / path.name}",
        )
    written = []
    for file, text in ((str(path), texts.text), *texts.overlay.items()):
        try:
            write_text(file, text, force=target is None or file in session.saved)
        except (RefusedError, OSError) as error:
            raise NotTakenError(str(error).removesuffix(" (-f overwrites it)")) from None
        session.saved.add(file)
        written.append(file)
    if session.watch is not None:
        session.watch.has_changed()  # it was we
    return written
