"""What a session writes: its score as it stands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ergon.exchange.safe import RefusedError, write_text
from ergon.repl.session.edits import parts
from ergon.repl.session.version import NotTakenError, piece_of

if TYPE_CHECKING:
    from ergon.repl.session.session import Session


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
    return written
