"""The checked piece: values in SI units, beats and seconds, every one with its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import floor, inf
from pathlib import Path
from typing import Literal, get_args

from ergon.instruments.model import Instrument, Layout, Module, Target
from ergon.notation.clock.meter import SAME, Meter
from ergon.notation.clock.occurrences import starts
from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables.strengths import MEZZO_FORTE, Level, Levels, Reach
from ergon.notation.tables.tuning import Tuning, of_path
from ergon.notation.text.document import Scalar
from ergon.notation.text.values import Place, Point, Time
from ergon.scores.gesture.notation import BarCheck
from ergon.scores.gesture.transforms import Transform
from ergon.scores.pattern.draws import Draws
from ergon.scores.pattern.pattern import Pattern, PlaceSequence
from ergon.scores.pattern.steps import Steps, steps
from ergon.scores.pattern.values import Amount
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.mixing import Fade, PanPath, Radiation, Room
from ergon.scores.reading.rhythms import Rhythm
from ergon.scores.reading.sweep_fields import Passing
from ergon.scores.reading.tones import Echo, Tone

# Fields that were added later: a digest omits them if empty, so that digests of older scores do not
# change.
OMIT_EMPTY = {"hash_omits_empty": True}
OMIT_NONE = {"hash_omits_none": True}
_ROUNDING = 1e-9  # tolerance for rounding of a number of frames

REFERENCE = 0.1  # of full scale: -20 dBFS; see Output.reference

Touch = Literal["open", "tracked"]
Ergons = Literal["event", "particle"]


@dataclass(frozen=True, slots=True)
class TempoEntry:
    """One line of `tempo:`; `tempos` are those of a MIDI file that it names."""

    at: Position
    bpm: float | None
    bpm_end: float | None
    over: Length | None
    meter: Meter | None
    place: Place
    tempos: tuple[tuple[float, float], ...] = field(default=(), metadata=OMIT_EMPTY)


@dataclass(frozen=True, slots=True)
class Mark:
    """A named instant."""

    name: str
    at: Position
    place: Place


@dataclass(frozen=True, slots=True)
class Key:
    """A force-feedback key: a small network with one struck MAT.

    `{M, K, Z}` is one CEL with the name "". `travel` [m]; the piece sees `reach` times the key's
    movement. Its springs act once in `every` frames. `measured` is what its calibration says of
    the real key: mass without modes [kg], damping [N·s/m], delay [s] if known.
    """

    name: str
    modules: tuple[Module, ...]
    struck: str
    travel: tuple[float, float] | None
    reach: float
    place: Place
    every: int = 1
    measured: tuple[float, float, float | None] | None = None


@dataclass(frozen=True, slots=True)
class PlayingOptions:
    """How a gesture is played; None stands for the gesture's own option, or for the default.

    `grain` [s] (None: dense), `join` [s], `force_limit` [N].
    """

    touch: Touch | None = None
    ergons: Ergons | None = None
    grain: float | None = None
    join: float | None = None
    force_limit: float | None = None
    layer: bool | None = None

    def over(self, other: PlayingOptions) -> PlayingOptions:
        """These options; those that are None are taken from `other`."""
        if self == NO_OPTIONS:
            return other
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return PlayingOptions(*(mine if mine is not None else theirs for mine, theirs in pairs))


NO_OPTIONS = PlayingOptions()
DEFAULT_OPTIONS = PlayingOptions("open", "event", None, 0.02, None, False)


@dataclass(frozen=True, slots=True)
class Gesture:
    """A narrative gesture: points, options of playing, and transformations."""

    name: str
    points: tuple[Point, ...]
    bar_checks: tuple[BarCheck, ...]
    do: tuple[Transform, ...]
    manner: PlayingOptions
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
    unit: float | None = field(metadata={"hash_omits_empty": True})
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
class NoteGlide:
    """How a pitch wheel moves the pitch of an instrument: factors, each at a time after the
    beginning of a phrase.
    """

    target: Target
    points: tuple[tuple[Length, float], ...]


@dataclass(frozen=True, slots=True)
class Hit:
    """One strike of a melody: at a position, or at a time after the beginning of a phrase.

    A strength lies within the `reach` [N·s] of what is struck.
    """

    at: Position | Length
    to: tuple[Target, ...]
    level: Level
    place: Place
    what: str = ""  # as it is written
    # The largest random displacement, earlier or later.
    jitter: Length = field(default=Length(), metadata=OMIT_EMPTY)
    reach: Reach | None = field(default=None, metadata=OMIT_EMPTY)
    lasting: Length | None = field(default=None, metadata=OMIT_EMPTY)  # None: it has no end


@dataclass(frozen=True, slots=True, kw_only=True)
class Strikes:
    """Ergons that hit modules directly: for each target at a Poisson `rate` [Hz], or one per
    `every`.

    `levels` say how strongly, strengths within the `reaches` [N·s] of what is struck; or a `mass`
    [kg] arrives at a `speed` [m/s]. A melody has `hits`. With a `length` it is a phrase: it begins
    at `at` and again every `every`, as do a sweep and a path (`passing`).
    """

    name: str
    to: tuple[Target, ...]
    at: Position
    span: Length | None = None
    until: Position | None = None
    rate: float | None = None
    every: Length | None = None
    times: int | None = None
    levels: Levels | None = None
    mass: float | None = None
    speed: float | None = None
    place: Place
    pattern: Pattern | None = field(default=None, metadata=OMIT_EMPTY)
    notes: Mapping[str, Amount] = field(default_factory=dict, metadata=OMIT_EMPTY)  # of the pattern
    # If the pattern's notes are those of an instrument: the targets of each note name.
    voices: Mapping[str, tuple[Target, ...]] = field(default_factory=dict, metadata=OMIT_EMPTY)
    hits: tuple[Hit, ...] = field(default=(), metadata=OMIT_EMPTY)
    length: Length | None = field(default=None, metadata=OMIT_EMPTY)
    passing: Passing | None = field(default=None, metadata=OMIT_EMPTY)
    # Direction as a unit vector; `to` then has the coordinates of all points, axis by axis.
    along: tuple[float, ...] = field(default=(), metadata=OMIT_EMPTY)
    reaches: Mapping[str, Reach] = field(default_factory=dict, metadata=OMIT_EMPTY)
    rhythm: Rhythm | None = field(default=None, metadata=OMIT_EMPTY)
    # How long each strike lasts [s]; None: as long as the engine says.
    lasts: float | None = field(default=None, metadata=OMIT_NONE)
    # The ratio by which a session scales the impulses, 0 where it mutes them; None: as written.
    session_gain: float | None = field(default=None, metadata=OMIT_EMPTY)
    glides: tuple[NoteGlide, ...] = field(default=(), metadata=OMIT_EMPTY)

    @property
    def moves_pitches(self) -> bool:
        """Whether what is struck changes its pitch: by a pattern of notes, or a pitch wheel."""
        return bool(self.notes or self.glides)

    @property
    def parts(self) -> frozenset[str]:
        """The parts that are struck; `to` has the targets of voices, hits and rhythms too."""
        return frozenset(target.part for target in self.to)

    @property
    def is_melody(self) -> bool:
        """Whether its strikes fall one by one, each with a name: those of a melody or a rhythm."""
        return bool(self.hits) or self.rhythm is not None

    @property
    def has_rounds(self) -> bool:
        """Whether strikes come in rounds: those of a melody, a sweep or a path."""
        return bool(self.hits) or self.passing is not None

    @property
    def who(self) -> str:
        """The name that keys the random draws of the strikes."""
        return f"strikes/{self.name}"

    def stop(self, tempo: TempoMap) -> float | None:
        """The beat at which they end; None if nothing ends them. Raises TextError."""
        if self.span is not None:
            return tempo.after(tempo.resolve(self.at), self.span)
        return None if self.until is None else tempo.resolve(self.until)

    def beats(self, tempo: TempoMap) -> Sequence[float]:
        """Beats of strikes without a pattern: one, or one per `every`. Raises TextError."""
        begin = tempo.resolve(self.at)
        if self.every is None:
            return [begin]
        stop = self.stop(tempo)
        return starts(tempo, begin, Length(), every=self.every, times=self.times, until=stop)

    def rounds(self, tempo: TempoMap) -> list[float]:
        """Beats on which rounds begin: one for each time a phrase is played. Raises TextError."""
        if self.length is None:
            return [0.0]
        until = None if self.until is None else tempo.resolve(self.until)
        begin, every, times = tempo.resolve(self.at), self.every, self.times
        return starts(tempo, begin, self.length, every=every, times=times, until=until)

    def falls(
        self, piece: Piece, since: float = -inf, before: float = inf
    ) -> Iterator[tuple[float, int, Hit]]:
        """The strikes of a melody or a rhythm: beat, number and hit. Raises TextError.

        Strikes of a rhythm are those between two beats; of a melody all are.
        """
        tempo = piece.tempo_map
        if self.rhythm is not None:
            yield from self._strokes(piece, self.rhythm, since, before)
            return
        until = inf if self.until is None or self.length else tempo.resolve(self.until) - SAME
        for turn, start in enumerate(self.rounds(tempo)):
            for number, hit in enumerate(self.hits):
                position = hit.at
                beat = (
                    tempo.resolve(position)
                    if isinstance(position, Position)
                    else tempo.after(start, position)
                )
                if beat < until:
                    yield beat, turn * len(self.hits) + number, hit

    def cycles(self, tempo: TempoMap, before: float = inf) -> int:
        """The number of cycles of a rhythm that begin before a beat. Raises TextError."""
        assert self.rhythm is not None
        stop = self.stop(tempo)
        count = self.rhythm.count(
            tempo, tempo.resolve(self.at), before if stop is None else min(stop, before)
        )
        return count if self.times is None else min(count, self.times)

    def _strokes(
        self, piece: Piece, rhythm: Rhythm, since: float, before: float
    ) -> Iterator[tuple[float, int, Hit]]:
        tempo, stop = piece.tempo_map, self.stop(piece.tempo_map)
        before = before if stop is None else min(stop, before)
        begin = tempo.resolve(self.at)
        first = 0
        if since != -inf:
            cycles_late, seconds_late = rhythm.late()
            early = tempo.after(since, Length(seconds=-seconds_late)) if seconds_late else since
            first = max(0, rhythm.count(tempo, begin, early) - 1 - cycles_late)
        cycles = range(first, self.cycles(tempo, before))
        levels = self.levels or Levels((MEZZO_FORTE,))
        for stroke in rhythm.strokes(tempo, begin, levels, (piece.seed, self.who), cycles):
            if not since - SAME <= stroke.beat < before - SAME:
                continue
            for to, reach in rhythm.voices[stroke.word]:
                long = Length(beats=stroke.lasting)
                word, level = stroke.word, stroke.level
                hit = Hit(Length(), to, level, self.place, word, reach=reach, lasting=long)
                yield stroke.beat, stroke.number, hit

    def steps(self, piece: Piece) -> Steps:
        """The places of the pattern, on which it strikes. Raises TextError."""
        assert self.pattern is not None
        tempo = piece.tempo_map
        begin, stop = tempo.resolve(self.at), self.stop(tempo)
        course = PlaceSequence(self.pattern, Draws(piece.seed, self.who))
        return steps(tempo, begin, course, every=self.every, times=self.times, until=stop)


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
    what: str
    at: Position
    every: Length | None
    times: int | None
    until: Position | None
    do: tuple[Transform, ...]
    manner: PlayingOptions
    place: Place
    at_place: Place
    until_place: Place | None
    pattern: Pattern | None = field(default=None, metadata=OMIT_EMPTY)  # None: `what` alone

    @property
    def names(self) -> tuple[str, ...]:
        """The gestures and takes that it may play, each once."""
        if self.pattern is None:
            return (self.what,)
        return tuple(dict.fromkeys(leaf.name or "" for leaf in self.pattern.leaves()))

    @property
    def chains(self) -> tuple[tuple[Transform, ...], ...]:
        """Its chains of transformations: its own, and those of the rounds of a pattern that have
        more.
        """
        turns = () if self.pattern is None else self.pattern.turns
        return (self.do, *((*self.do, *turn.transforms()) for turn in turns))

    def course(self, seed: int) -> PlaceSequence:
        """What a pattern plays in each of its places, with all chance derived from `seed`."""
        assert self.pattern is not None
        return PlaceSequence(self.pattern, Draws(seed, f"{self.player}/{self.what}"))


@dataclass(frozen=True, slots=True)
class Route:
    """From outputs of an instrument (`out` None: all) to channels (from 1); `gain` is a ratio."""

    part: str
    out: str | None
    to: tuple[int, ...] | Literal["nearest"]
    gain: float
    highpass: float | None
    place: Place
    pan: tuple[float, float] | None = field(
        default=None, metadata=OMIT_EMPTY
    )  # gains of two channels
    sends: tuple[tuple[str, float], ...] = field(default=(), metadata=OMIT_EMPTY)  # rooms, ratios
    fade: Fade = field(default=(), metadata=OMIT_EMPTY)
    radiation: Radiation | None = field(default=None, metadata=OMIT_EMPTY)
    level: float | None = field(default=None, metadata=OMIT_EMPTY)  # of a stroke at mf [LUFS]
    # The ratio that leads to that level, once the instrument is known.
    level_ratio: float | None = field(default=None, metadata=OMIT_EMPTY)
    pan_path: PanPath = field(default=(), metadata=OMIT_EMPTY)  # in place of `pan`
    tones: tuple[Tone, ...] = field(default=(), metadata=OMIT_EMPTY)  # after the highpass
    echo: Echo | None = field(default=None, metadata=OMIT_EMPTY)

    @property
    def is_panned(self) -> bool:
        """Whether its sound has a place between two channels."""
        return self.pan is not None or bool(self.pan_path)

    @property
    def ratio(self) -> float:
        """The ratio of an output to its channels: the gain, and what leads to the level."""
        return self.gain if self.level_ratio is None else self.gain * self.level_ratio


@dataclass(frozen=True, slots=True)
class Master:
    """Processing of all channels together; levels are ratios of full scale."""

    normalise: float | None
    limit: float | None
    gain: float
    place: Place
    fade: Fade = field(default=(), metadata=OMIT_EMPTY)
    reference: float | Literal["SI"] | None = field(default=None, metadata=OMIT_EMPTY)
    loudness: float | None = field(default=None, metadata=OMIT_EMPTY)  # of the sum [LUFS]

    @property
    def is_levelled(self) -> bool:
        """Whether the level of the sum follows from what the whole piece measures."""
        return self.normalise is not None or self.loudness is not None


@dataclass(frozen=True, slots=True)
class Mix:
    """Loudspeakers and the ways to them."""

    channels: int
    layout: Layout | None
    routes: tuple[Route, ...]
    master: Master | None
    place: Place | None
    rooms: tuple[Room, ...] = field(default=(), metadata=OMIT_EMPTY)

    def reference(self, *, is_measured: bool = False) -> float | None:
        """The ratio of full scale at which reference quantities are heard.

        None if samples are in SI units: if the score says so, or if a file of floats is written
        (`is_measured`) whose master brings the sum to no level.
        """
        master = self.master
        if master is not None and master.reference is not None:
            return None if master.reference == "SI" else master.reference
        is_levelled = master is not None and master.is_levelled
        return None if is_measured and not is_levelled else REFERENCE


@dataclass(frozen=True, slots=True)
class RenderSpec:
    """The file that `render` writes; `tail` [s] after the last event, or until it has faded."""

    file: str | None
    bits: Literal[16, 24, "float"]
    tail: float | Literal["auto"]
    channels: int | None
    place: Place | None


Method = Literal["ca", "modal", "ca2p", "bm4", "ieq"]
METHODS: tuple[Method, ...] = get_args(Method)


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The required exactness: by one method, within an error [dB], or within cents up to a pitch.

    Without any of these, errors stay inaudible. `upto` [Hz]; `cpu` is the most work, 1.0 one
    core at real time. `is_unguarded`: no frame of CA is computed finer, even if links stiffen
    too much.
    """

    method: Method | None = None
    error: float | None = None
    cents: float | None = None
    upto: float | None = None
    cpu: float | None = None
    is_unguarded: bool = field(default=False, metadata={"hash_omits_empty": True})


@dataclass(frozen=True, slots=True)
class Piece:
    """A whole score, checked. Parts are in the order written, marks in the order of names."""

    title: str
    seed: int
    rate: float
    tempo: tuple[TempoEntry, ...]
    marks: tuple[Mark, ...]
    keys: Mapping[str, Key]
    instruments: Mapping[str, Instrument]
    gestures: Mapping[str, Gesture]
    takes: Mapping[str, TakeFile]
    strikes: tuple[Strikes, ...]
    players: Mapping[str, Player]
    duet: tuple[Coupling, ...]
    parts: tuple[Play, ...]
    mix: Mix
    render: RenderSpec
    accuracy: Accuracy
    place: Place
    tempo_map: TempoMap = field(compare=False, repr=False)
    # For each line of the parts, the beats on which it is played; None if only a take's file tells
    # its length.
    starts: tuple[Sequence[float] | None, ...] = field(default=(), compare=False, repr=False)
    automation: tuple[Automation, ...] = field(default=(), metadata=OMIT_EMPTY)
    # Lines of a session by the name of their block; only sessions read them.
    blocks: Mapping[str, Sequence[str]] = field(default_factory=dict, compare=False, repr=False)
    # The names of the members of each instrument with notes.
    families: Mapping[str, tuple[str, ...]] = field(default_factory=dict, compare=False, repr=False)

    # The lowest rate of parts that are only seen [Hz]; None: the audio rate.
    motion: float | None = field(default=None, metadata=OMIT_EMPTY)

    # The meters of a MIDI file that `meter:` names, as in `FileTimes`.
    file_meters: tuple[tuple[float, Meter], ...] = field(default=(), metadata=OMIT_EMPTY)
    # What strikes may play: the names of phrases, and of takes that are MIDI files.
    phrases: tuple[str, ...] = field(default=(), compare=False, repr=False)
    # Instruments that a file brings and nothing plays yet; they are not in the network.
    available: Mapping[str, Instrument] = field(default_factory=dict, compare=False, repr=False)
    # The names by which `use:` brings files in: prefixes, or names of files.
    used: tuple[str, ...] = field(default=(), compare=False, repr=False)
    # Of its notes; what is computed has their frequencies.
    tuning: Tuning | None = field(default=None, compare=False, repr=False)
    # Of instruments with their own, by name.
    tunings: Mapping[str, Tuning] = field(default_factory=dict, compare=False, repr=False)

    @property
    def motion_every(self) -> int:
        """The number of frames from one step of parts that are only seen to the next."""
        return 1 if self.motion is None else max(1, floor(self.rate / self.motion + _ROUNDING))

    def modules(self) -> Iterator[tuple[str, Module]]:
        """Every module of the keys and instruments, with the name of its part."""
        for key in self.keys.values():
            yield from ((key.name, module) for module in key.modules)
        for instrument in self.instruments.values():
            yield from ((instrument.name, module) for module in instrument.modules)

    def routes(self) -> tuple[Route, ...]:
        """The routes of the mix; without any, each output has a channel of its own, in the order
        written, and the notes of an instrument share its channels.
        """
        if self.mix.routes:
            return self.mix.routes
        family = self.note_families()
        channels: dict[tuple[str, str], int] = {}
        routes = []
        for instrument in self.instruments.values():
            for output in instrument.outputs:
                name = family.get(instrument.name, instrument.name), output.name
                channel = channels.setdefault(name, len(channels) + 1)
                routes.append(
                    Route(instrument.name, output.name, (channel,), 1.0, None, output.place)
                )
        return tuple(routes)

    def playable(self, name: str) -> Instrument | None:
        """The instrument of a name, or of its first note; also one that nothing plays yet."""
        first = self.families.get(name, (name,))[0]
        return self.instruments.get(first) or self.available.get(name)

    def tuning_of(self, path: str) -> Tuning | None:
        """The tuning of the notes of what a path names: of its instrument, or of the score."""
        return of_path(path, self.tunings, self.tuning)

    def note_families(self) -> dict[str, str]:
        """The instrument that each note belongs to, by the name of the note's part."""
        return {part: name for name, parts in self.families.items() for part in parts}
