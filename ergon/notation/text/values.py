"""Values that every part of the text layer shares: instants, places, points."""

from dataclasses import dataclass
from typing import NamedTuple

from ergon.common.shown_paths import shown


class Time(NamedTuple):
    """An instant or a length: `tempo.seconds(start + beats) + seconds`."""

    beats: float = 0.0
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class Place:
    """Where something is written: file, line and column (from 1), and how many characters."""

    file: str
    line: int
    column: int
    length: int = 1

    def __str__(self) -> str:
        """`file:line:column`, the form that editors jump to."""
        return f"{shown(self.file)}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True)
class Point:
    """A point of a gesture: `x` [m] at `at`. `curve` shapes the path to it; `offset` and `length`
    mark its text.
    """

    at: Time
    x: float
    curve: str
    offset: int
    length: int
