"""What a session shows to whoever types: one line in, one reply out."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Reply:
    """What became of a line; one that was not taken has changed nothing.

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

    @property
    def where(self) -> str:
        """Bar and beat that sound: `3|2`."""
        return f"{self.bar}|{int(self.beat)}"


class Suggestion(Protocol):
    """How a line may go on: `text` takes the place of what stands from `start` to the cursor."""

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
    """A session, seen from the keyboard.

    `submit` is called a line at a time; the others meanwhile, from another thread, so often that
    they may take no time.
    """

    def submit(self, text: str, *, releases: bool = True) -> Reply:
        """Do a line, or a block of lines as one version. Raises nothing; may take a while.

        A line after which a stop was entered `releases` nothing: no sound and no force that the
        stop has ended.
        """

    def state(self) -> State:
        """Where it is and what is heard."""

    def messages(self) -> Sequence[str]:
        """What happened since the last call, a sentence each."""

    def panic(self) -> None:
        """Silence and no force, at once, also while a line is at work."""

    def let_go(self) -> None:
        """No force on any hand, at once, until `release`; the sound goes on."""

    def input_ends(self) -> None:
        """Nobody can enter a stop here any more: where the session ends with this, let go."""

    def cancel(self) -> bool:
        """Drop the line that is being computed; whether there is one. From any thread."""

    def close(self) -> None:
        """Hush, and let go of everything; the last call."""

    def complete(self, line: str, cursor: int) -> Sequence[Suggestion]:
        """How a line may go on at a column."""

    def tokens(self, line: str) -> Sequence[tuple[int, int, str]]:
        """What a line's words are, for colours: (start, end, kind)."""

    def is_whole(self, text: str) -> bool:
        """Whether Enter ends it; a line that ends in a backslash goes on."""


# By the first word, or its beginning as far as the language knows it. A name that is defined is no
# stop; whatever else stands behind the word, zero force is the answer to a doubt.
_STOP = re.compile(r"[ \t]*(?:(?P<panic>pa|pan|pani|panic)|(?P<quit>qui|quit))(?![^\s#])(?!\s*=)")


def stop_of(text: str) -> str | None:
    """Which stop a line, or one line of a block, asks for: "panic", "quit" or None."""
    found = {match.lastgroup for line in text.split("\n") if (match := _STOP.match(line))}
    return "panic" if "panic" in found else "quit" if found else None
