"""What a prompt sees of a session, in this process or another."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a line; a line that was not taken has changed nothing.

    `text` is what was done (`ok 3|1 knock: 3 points`) or, in one line, why not. `try_` is the whole
    line to type instead. `lines` are a drawing, help or a list, shown as they are. A reply that
    `leaves` is the last.
    """

    taken: bool
    text: str
    try_: str | None = None
    lines: tuple[str, ...] = ()
    leaves: bool = False


@dataclass(frozen=True, slots=True)
class State:
    """One look at a session: bars and beats count from 1, `tempo` in bpm, `load` as a share of
    real time, `level` in dB below full scale (-inf in silence), `recording` in seconds, or None."""

    bar: int
    beat: float
    tempo: float
    playing: tuple[tuple[str, str], ...] = ()  # (player, what)
    load: float = 0.0
    late: int = 0
    level: float = float("-inf")
    quant: str = "bar"
    recording: float | None = None
    panicked: bool = False
    let_go: bool = False  # no force on any hand, though the sound goes on
    troubles: tuple[str, ...] = ()  # what is wrong, in a few words each
    drawing: tuple[str, ...] = ()  # of a key that is traced, above the status line

    @property
    def where(self) -> str:
        """Bar and beat that sound: `3|2`."""
        return f"{self.bar}|{int(self.beat)}"


class Suggestion(Protocol):
    """A completion: `text` replaces what stands from column `start` to the cursor."""

    @property
    def text(self) -> str:
        """What to insert."""

    @property
    def start(self) -> int:
        """From which column."""

    @property
    def hint(self) -> str:
        """What it does, in a few words."""


class SessionProtocol(Protocol):
    """A session as a prompt sees it.

    `submit` is called a line at a time; the others meanwhile, from another thread, so often that
    they may take no time.
    """

    def submit(self, text: str, *, releases: bool = True) -> Reply:
        """Do a line, or a block of lines as one version. Raises nothing; may take a while.

        A line after which a stop was entered `releases` nothing: no sound and no force that the
        stop has ended.
        """

    def state(self) -> State:
        """Position, tempo, what plays, load and level."""

    def messages(self) -> Sequence[str]:
        """Messages since the last call, one sentence each."""

    def panic(self) -> None:
        """Silence and no force, at once, also while a line is at work."""

    def let_go(self) -> None:
        """No force on any hand, at once, until `release`; the sound goes on."""

    def input_ends(self) -> None:
        """Note that no line follows; a session that ends with its prompt ends all forces."""

    def cancel(self) -> bool:
        """Cancel the line that is being computed, from any thread; False where none is."""

    def close(self) -> None:
        """End the session; the last call."""

    def complete(self, line: str, cursor: int) -> Sequence[Suggestion]:
        """Completions of a line at a column."""

    def tokens(self, line: str) -> Sequence[tuple[int, int, str]]:
        """The kinds of a line's words, for colours: (start, end, kind)."""

    def is_whole(self, text: str) -> bool:
        """Whether Enter ends the text; a line that ends in a backslash goes on."""


# The first word or its short form decides. `panic = …` defines a gesture; anything else behind
# the word is taken as a stop, because zero force is the safe reading.
_STOP = re.compile(r"[ \t]*(?:(?P<panic>pa|pan|pani|panic)|(?P<quit>qui|quit))(?![^\s#])(?!\s*=)")


def stop_of(text: str) -> str | None:
    """Which stop a line, or one line of a block, asks for: "panic", "quit" or None."""
    found = {match.lastgroup for line in text.split("\n") if (match := _STOP.match(line))}
    return "panic" if "panic" in found else "quit" if found else None
