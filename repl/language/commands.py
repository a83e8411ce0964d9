"""What a typed line asks for: one class for each thing that can be asked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from ergon.notation.clock.positions import Length, Position
from ergon.scores.gesture.notation import Notation
from ergon.scores.gesture.transforms import Transform
from ergon.scores.reading.piece import Manner


class Now(Enum):
    """The next tick, whatever `quant` says."""

    NOW = "now"


NOW: Final = Now.NOW
When = Now | Position | Length | None  # `now`, `at C`, `in 2`; None: the next boundary of `quant`


class Word(NamedTuple):
    """A value as it was written, and where: characters of the submitted text."""

    text: str
    start: int
    end: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """When it acts, and its values as written, by the names of its fields.

    An option of `plays` is under its own name (`every`, `from`, `grain`), and all of them without
    when are under `play`, as a part's table has them. What `set` changes to is under `change`.
    """

    when: When = None
    words: Mapping[str, Word] = field(default_factory=dict, compare=False, repr=False)


# --- what is played ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Define(Command):
    """`knock = 0@0 6@1/8 0@1/4`: the gesture is written so from now on."""

    name: str
    notation: Notation


@dataclass(frozen=True, slots=True)
class Plays(Command):
    """`ada plays knock every 1`: in place of what the player plays."""

    player: str
    what: str
    every: Length | None
    times: int | None
    until: Position | None
    do: tuple[Transform, ...]
    manner: Manner


@dataclass(frozen=True, slots=True)
class Do(Command):
    """`ada do mirror`: done to what the player plays, after what is done to it already."""

    player: str
    do: tuple[Transform, ...]


@dataclass(frozen=True, slots=True)
class Rest(Command):
    """No further occurrence; the one in flight ends. None: every player."""

    player: str | None


@dataclass(frozen=True, slots=True)
class Hush(Command):
    """No more ergons; what sounds rings out."""


@dataclass(frozen=True, slots=True)
class Damp(Command):
    """Silence by viscosity, within `time` [s]."""

    time: float


@dataclass(frozen=True, slots=True)
class Panic(Command):
    """Silence at once."""


@dataclass(frozen=True, slots=True)
class Release(Command):
    """Sound and forces again, after a panic."""


# --- time ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Play(Command):
    """The piece runs, from a position or from where it stopped."""

    start: Position | None


@dataclass(frozen=True, slots=True)
class Stop(Command):
    """The piece stands still."""


@dataclass(frozen=True, slots=True)
class Tempo(Command):
    """`tempo 72`, or `tempo 60 -> 84 over 4bar`: then `end` and `over` are given."""

    bpm: float
    end: float | None = None
    over: Length | None = None


@dataclass(frozen=True, slots=True)
class Tap(Command):
    """A beat is now; several of them are a tempo."""


@dataclass(frozen=True, slots=True)
class Nudge(Command):
    """The beat comes later by this; negative: earlier."""

    by: Length


@dataclass(frozen=True, slots=True)
class Quant(Command):
    """The boundaries on which lines act that do not say when."""

    grid: Now | Length


# --- matter --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Set(Command):
    """A physical parameter gets a value [SI], or is multiplied by a factor; it glides `over`."""

    target: str
    value: float | None
    factor: float | None
    over: Length | None


@dataclass(frozen=True, slots=True)
class Couple(Command):
    """A REF between two keys: `stiffness` [N/m], `viscosity` [Ns/m]."""

    a: str
    b: str
    stiffness: float
    viscosity: float


@dataclass(frozen=True, slots=True)
class Uncouple(Command):
    """What joins two keys goes."""

    a: str
    b: str


@dataclass(frozen=True, slots=True)
class Guide(Command):
    """A real hand's key is led along another player's ergons; by None: no longer.

    `stiffness` [N/m] and `viscosity` [Ns/m] of the lead, None where they are not said.
    """

    player: str
    by: str | None = None
    stiffness: float | None = None
    viscosity: float | None = None


@dataclass(frozen=True, slots=True)
class Record(Command):
    """A real key's movement becomes a take."""

    player: str
    take: str


@dataclass(frozen=True, slots=True)
class RecordOff(Command):
    """The recording ends."""


@dataclass(frozen=True, slots=True)
class Gain(Command):
    """A ratio of amplitudes, for an instrument or a player; None: for everything."""

    name: str | None
    ratio: float


@dataclass(frozen=True, slots=True)
class Mute(Command):
    """An instrument or a player is not heard."""

    name: str


@dataclass(frozen=True, slots=True)
class Solo(Command):
    """Only this instrument or player is heard."""

    name: str


@dataclass(frozen=True, slots=True)
class Unmute(Command):
    """It is heard again; None: everything is."""

    name: str | None


@dataclass(frozen=True, slots=True)
class Seed(Command):
    """The number that every chance derives from."""

    seed: int


# --- versions and files --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Undo(Command):
    """The version before."""


@dataclass(frozen=True, slots=True)
class Redo(Command):
    """The version that was undone."""


@dataclass(frozen=True, slots=True)
class History(Command):
    """The versions, with the bars in which they began."""


@dataclass(frozen=True, slots=True)
class Back(Command):
    """So many versions back."""

    count: int


@dataclass(frozen=True, slots=True)
class Keep(Command):
    """What was played in the last `length` gets a name."""

    length: Length
    name: str


@dataclass(frozen=True, slots=True)
class Save(Command):
    """The score is written; None: to its own file."""

    file: str | None


@dataclass(frozen=True, slots=True)
class Load(Command):
    """Another score takes the place of this one."""

    file: str


@dataclass(frozen=True, slots=True)
class Reload(Command):
    """The score's file is read again; what differs changes."""


# --- looking -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Look(Command):
    """What a name is, drawn where it can be; nothing is played."""

    name: str


@dataclass(frozen=True, slots=True)
class Show(Command):
    """What plays, or what there is of a name."""

    name: str | None


@dataclass(frozen=True, slots=True)
class Trace(Command):
    """A movement as it is now."""

    name: str


@dataclass(frozen=True, slots=True)
class Meters(Command):
    """The level of every channel."""


@dataclass(frozen=True, slots=True)
class Help(Command):
    """The verbs, or one of them."""

    verb: str | None


@dataclass(frozen=True, slots=True)
class Py(Command):
    """A Python expression over the session."""

    expression: str


@dataclass(frozen=True, slots=True)
class Quit(Command):
    """Hands lift, the session ends."""
