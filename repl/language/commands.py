"""Commands: one class for each thing that a typed line can ask for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from ergon.notation.clock.positions import Length, Position


class Now(Enum):
    """The next tick, whatever `quant` says."""

    NOW = "now"


NOW: Final = Now.NOW


@dataclass(frozen=True, slots=True)
class Sync:
    """The next beginning of another voice: of its cycle, its round, or its next stroke."""

    name: str


# `now`, `at C`, `in 2`, `sync d1`; None: the next boundary of `quant`
When = Now | Position | Length | Sync | None


class Word(NamedTuple):
    """A value as it was written, and its place in the submitted text, in characters."""

    text: str
    start: int
    end: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """When a command acts, and its values as written, by the names of its fields.

    An option of `plays` is under its own name (`every`, `from`, `grain`); `play` has the whole
    of it without the time, as the table of a part has it. The value or factor of `set` is under
    `change`.
    """

    when: When = None
    words: Mapping[str, Word] = field(default_factory=dict, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class BlockCommand(Command):
    """A command that a block may hold: it changes the music at the beat on which the block runs.

    It is not about files, history, other blocks or real hands.
    """
