"""What hands play: keys, gestures, takes, players and the lines of their parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal

from ergon.instruments.model import Module, Target
from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.document import Scalar
from ergon.notation.text.values import Place, Point, Time
from ergon.scores.gesture.notation import BarCheck
from ergon.scores.gesture.transforms import Transform
from ergon.scores.pattern.draws import Draws
from ergon.scores.pattern.pattern import Pattern, PlaceSequence
from ergon.scores.reading.digest_marks import OMIT_EMPTY

TouchMode = Literal["open", "tracked"]
ErgonMode = Literal["event", "particle"]


@dataclass(frozen=True, slots=True)
class Key:
    """A force-feedback key: a small network with one struck MAT.

    `{M, K, Z}` is one CEL with the name "". `travel` [m]; the piece sees `reach` times the key's
    movement. Its springs act once in `every` frames. `measured_constants` is what its calibration
    says of the real key: mass without modes [kg], damping [N·s/m], delay [s] if known. The forces
    of the piece reach the struck MAT `delay` [s] later.
    """

    name: str
    modules: tuple[Module, ...]
    struck: str
    travel: tuple[float, float] | None
    reach: float
    place: Place
    every: int = 1
    measured_constants: tuple[float, float, float | None] | None = None
    delay: float = field(default=0.0, metadata=OMIT_EMPTY)


@dataclass(frozen=True, slots=True)
class PlayingOptions:
    """How a gesture is played; None stands for the gesture's own option, or for the default.

    `grain` [s] (None: dense), `join` [s], `force_limit` [N].
    """

    touch: TouchMode | None = None
    ergons: ErgonMode | None = None
    grain: float | None = None
    join: float | None = None
    force_limit: float | None = None
    layer: bool | None = None

    def with_defaults(self, base_options: PlayingOptions) -> PlayingOptions:
        """These options; those that are None are taken from `base_options`."""
        if self == NO_OPTIONS:
            return base_options
        option_pairs = (
            (getattr(self, f.name), getattr(base_options, f.name)) for f in fields(self)
        )
        return PlayingOptions(
            *(option if option is not None else default for option, default in option_pairs)
        )


NO_OPTIONS = PlayingOptions()
DEFAULT_OPTIONS = PlayingOptions("open", "event", None, 0.02, None, False)


@dataclass(frozen=True, slots=True)
class Gesture:
    """A narrative gesture: points, options of playing, and transformations."""

    name: str
    points: tuple[Point, ...]
    bar_checks: tuple[BarCheck, ...]
    do: tuple[Transform, ...]
    options: PlayingOptions
    place: Place
    written: Scalar | None = field(default=None, compare=False, repr=False)
    # Whether its beats are quarter notes (of a MIDI file), whatever beats the meter has.
    in_quarters: bool = field(default=False, metadata=OMIT_EMPTY)

    def beat(self, tempo: TempoMap, start: float) -> float:
        """The duration of one of its beats at a beat of the piece [s]."""
        beat = 60.0 / tempo.bpm(start)
        return beat * tempo.bars.unit(start) / 4.0 if self.in_quarters else beat

    def instant(self, tempo: TempoMap, start: float, time: Time) -> float:
        """The instant of a time in it, played from a beat of the piece on [s]."""
        if self.in_quarters:
            start, time = tempo.after(start, self.length(Time(time.beats))), Time(0.0, time.seconds)
        return tempo.instant(start, time)

    def length(self, time: Time) -> Length:
        """A time in it as a length of the piece."""
        if self.in_quarters:
            return Length(seconds=time.seconds, quarters=time.beats)
        return Length(0.0, *time)

    def place_of(self, point: Point) -> Place:
        """Where a point is written."""
        if self.written is None:
            return self.place
        return self.written.place_at(point.offset, point.length)


@dataclass(frozen=True, slots=True)
class SoundInput:
    """An input of a sound card with its channel from 1, or (`channel` None) one whose values come
    by OSC.

    Full scale is `gain` [N] for a force, [m] for a length; values are limited to ±`clamp` [N or
    m]. The signal of a card first passes a high-pass at `highpass` [Hz]; values by OSC are not
    filtered, and each is reached within `glide` [s].
    """

    channel: int | None
    gain: float
    is_force: bool
    highpass: float | None
    clamp: float
    glide: float | None = field(default=None, metadata=OMIT_EMPTY)


@dataclass(frozen=True, slots=True)
class TakeFile:
    """A captured movement in a file; `trim` [s], `smooth` [Hz], `rate` [Hz] for a file without a
    time column.

    `unit` [m] is what 1.0 means if the file does not tell. The file of an `input` is optional,
    and is heard if there is no sound card.
    """

    name: str
    path: Path | None
    channel: str | None
    trim: tuple[float, float] | None
    smooth: float | None
    rate: float | None
    unit: float | None = field(metadata=OMIT_EMPTY)
    place: Place
    places: Mapping[str, Place] = field(default_factory=dict, compare=False, repr=False)
    input: SoundInput | None = field(default=None, metadata=OMIT_EMPTY)

    @property
    def card_channel(self) -> int | None:
        """The channel of the sound card, from 1; None for a take that is not an input of a card."""
        return None if self.input is None else self.input.channel

    @property
    def is_from_osc(self) -> bool:
        """Whether its values come by OSC."""
        return self.input is not None and self.input.channel is None


@dataclass(frozen=True, slots=True)
class Player:
    """A hand on a key."""

    name: str
    hand: Literal["virtual", "live"]
    key: str
    device: str | None
    standin: str | None
    tick: float | None
    place: Place


@dataclass(frozen=True, slots=True)
class Coupling:
    """A link between two keys that acts from `at` on."""

    link: Module
    a: Target
    b: Target
    at: Position
    until: Position | None
    place: Place


@dataclass(frozen=True, slots=True)
class Play:
    """A line of a part: a gesture, a take or a pattern of them, when, how often and how."""

    player: str
    played_text: str
    at: Position
    every: Length | None
    times: int | None
    until: Position | None
    do: tuple[Transform, ...]
    options: PlayingOptions
    place: Place
    begin_place: Place
    until_place: Place | None
    pattern: Pattern | None = field(default=None, metadata=OMIT_EMPTY)  # None: `played_text` alone

    @property
    def names(self) -> tuple[str, ...]:
        """The gestures and takes that it may play, each once."""
        if self.pattern is None:
            return (self.played_text,)
        return tuple(dict.fromkeys(leaf.name or "" for leaf in self.pattern.leaves()))

    @property
    def transform_chains(self) -> tuple[tuple[Transform, ...], ...]:
        """Its chains of transformations: its own, and those of the rounds of a pattern that have
        more.
        """
        turns = () if self.pattern is None else self.pattern.turns
        return (self.do, *((*self.do, *turn.transforms()) for turn in turns))

    def place_sequence(self, seed: int) -> PlaceSequence:
        """What a pattern plays in each of its places, with all chance derived from `seed`."""
        assert self.pattern is not None
        return PlaceSequence(self.pattern, Draws(seed, f"{self.player}/{self.played_text}"))
