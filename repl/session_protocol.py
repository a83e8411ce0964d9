"""A session as a prompt sees it, in this process or in another."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import NamedTuple, Protocol


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a line; a line that was not taken has changed nothing.

    `text` says what was done (`ok 3|1 knock: 3 points`) or, in one line, why not. `try_` is the
    whole line to type instead. `lines` are a drawing, help or a list, shown as they are. After a
    reply that `leaves`, the prompt ends.
    """

    taken: bool
    text: str
    try_: str | None = None
    lines: tuple[str, ...] = ()
    leaves: bool = False

    def __str__(self) -> str:
        """What is shown: the text, what to type instead, and the lines."""
        instead = [] if self.try_ is None else [f"try: {self.try_}"]
        return "\n".join([self.text, *instead, *self.lines])

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


@dataclass(frozen=True, slots=True)
class State:
    """The present state of a session: bars and beats count from 1, `tempo` in bpm, `load` as a
    share of real time, `level` in dB below full scale (-inf in silence), `recording` in seconds,
    or None.
    """

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
        """The present bar and beat: `3|2`."""
        return f"{self.bar}|{int(self.beat)}"


class SoundingPlace(NamedTuple):
    """Something that sounds: the file, line and column (from 1) where it is written, the characters
    that are marked there, when it begins and ends [s of the session], and what it is.

    The file may differ from the session's text by lines that were typed: the place is good as long
    as `text` stands there. What has no end of its own ends when it begins.
    """

    file: str
    line: int
    column: int
    text: str
    start: float
    end: float
    what: str


class Sounding(NamedTuple):
    """The present instant of a session [s], and what has begun since the last look."""

    now: float
    began: tuple[SoundingPlace, ...]


class Suggestion(NamedTuple):
    """A completion: `text` replaces the characters from column `start` to the cursor."""

    text: str
    start: int
    hint: str


class SessionProtocol(Protocol):
    """A session as a prompt sees it.

    `submit` is called for one line at a time. Meanwhile another thread calls the other methods,
    often, so that they must return at once.
    """

    def submit(self, text: str, *, releases: bool = True) -> Reply:
        """Do a line, or a block of lines as one version. Raises nothing; may take a while.

        `releases` is False if a stop was entered after the line: then the line switches neither
        sound nor force on again.
        """

    def state(self) -> State:
        """Position, tempo, what plays, load and level."""

    def messages(self) -> Sequence[str]:
        """Messages since the last call, one sentence each."""

    def panic(self) -> None:
        """End sound and force at once, also while a line is being computed."""

    def let_go(self) -> None:
        """End every force at once, until `release`; the sound goes on."""

    def end_input(self) -> None:
        """Note that no further line comes; a session that ends with its prompt ends all forces."""

    def cancel(self) -> bool:
        """Cancel the line that is being computed, from any thread; False if there is none."""

    def close(self) -> None:
        """End the session; no call follows."""

    def complete(self, line: str, cursor: int) -> Sequence[Suggestion]:
        """Completions of a line at a column."""

    def tokens(self, line: str) -> Sequence[tuple[int, int, str]]:
        """The kinds of a line's words, for colours: (start, end, kind)."""

    def is_whole(self, text: str) -> bool:
        """Whether Enter ends the text; not if it ends in a backslash or within a block."""


# Alone on a line, or with `now` or a comment: a line that the language refuses must not act.
_STOP_PATTERN = re.compile(
    r"[ \t]*(?:(?P<panic>pa|pani|panic)|(?P<quit>qui|quit))(?:[ \t]+now)?[ \t\r]*"
    r"(?:(?<=[ \t])#.*)?"
)


def stop_of(text: str) -> str | None:
    """The stop that a line, or any line of a block, asks for: "panic", "quit" or None."""
    stops = {
        match.lastgroup for line in text.split("\n") if (match := _STOP_PATTERN.fullmatch(line))
    }
    return "panic" if "panic" in stops else "quit" if stops else None


class SignalWatch(Protocol):
    """Makes signals end forces before Python handles them, as `_core.stop_on_signals` does.

    It has to be called after every change of a handler, because that replaces its own.
    """

    def __call__(self, signals: Sequence[int], *, ends: bool | None) -> None:
        """On these signals: if the program `ends`, end every force and sound; else, every force;
        None: do nothing.
        """
