"""What `?`, `show` and `scope` print: curves, lines of the score, who plays what."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ergon.notation.text.document import Mapping
from ergon.notation.text.spelling import nearest
from ergon.repl.session.version import NotTakenError
from ergon.repl.session.version_edits import rehearsed

if TYPE_CHECKING:
    from ergon.repl.session.running import Running
    from ergon.repl.session.version import Version
    from ergon.scores.edits.texts import Texts

_ROOM = 0.02  # [s] drawn before a gesture: its joining curve
_WIDTH_MAX, _HEIGHT = 100, 16  # characters
_POINTS = 4  # of a curve in each character: two in each dot
_LINES_MAX = 40  # of a definition
_SECTIONS = ("parts", "gestures", "takes", "keys", "instruments", "players", "marks", "strikes")


def drawn(version: Version, name: str) -> list[str]:
    """The written and the played curve of a gesture or take; for other names their definition."""
    from ergon.view.braille import plot
    from ergon.view.motion import asked_and_done

    piece = version.piece
    if name not in piece.gestures and name not in piece.takes:
        return show(version, name)
    if not piece.keys:
        raise NotTakenError("a gesture is drawn on a key, and this score has none")
    alone = rehearsed(piece, name)[0]
    first = alone.gestures[0]
    start, stop = max(0.0, first.start - _ROOM), first.stop
    reach = piece.keys[first.key].reach
    width = min(shutil.get_terminal_size().columns, _WIDTH_MAX)
    curves = asked_and_done(
        alone.simulation, first.key_index, first.struck, start, stop, reach, _POINTS * width
    )
    text = plot(curves, width=width, height=_HEIGHT, x_label="position [mm]")
    return [f"{name} on {first.key}", *text.splitlines()]


def scoped(running: Running, frame: int, name: str) -> list[str]:
    """Draw the gesture that a player is playing."""
    playing = dict(running.in_flight(frame))
    if name not in playing:
        raise NotTakenError(f"{name} is playing no gesture now; `show` lists the players")
    return drawn(running.version, playing[name])


def show(version: Version, name: str | None) -> list[str]:
    """Who plays what; or the lines of the score that define a name, with their numbers."""
    if name is not None:
        return _defined(version.texts, name)
    piece, tempo = version.piece, version.piece.tempo_map
    rows = [f"{entry.at.text}: {entry.bpm or ''} bpm" for entry in piece.tempo]
    for player in piece.players.values():
        mine = [play for play in piece.parts if play.player == player.name]
        said = "nothing"
        if mine:
            last = max(mine, key=lambda play: tempo.resolve(play.at))
            until = f" until {last.until.text}" if last.until is not None else ""
            said = f"{last.what} from {last.at.text}{until}"
        rows.append(f"{player.name} ({player.hand}, {player.key}): {said}")
    return rows


def _defined(texts: Texts, name: str) -> list[str]:
    known: list[str] = []
    for file in (texts.path, *texts.overlay):
        document = texts.document(file)
        if not isinstance(document.root, Mapping):
            continue
        for section in _SECTIONS:
            node = document.root.get(section)
            if not isinstance(node, Mapping):
                continue
            known += node.entries
            if name in node.entries:
                first, last = node.entries[name]
                row, stop = document.row(first.start), document.row(max(last.end - 1, last.start))
                numbers: Sequence[int] = range(row + 1, min(stop + 2, row + 1 + _LINES_MAX))
                return [f"{number:5} {document.line(number)}" for number in numbers]
    close = nearest(name, known)
    raise NotTakenError(
        f"'{name}' is not defined in this score", None if close is None else f"show {close}"
    )
