"""The checked piece: values in SI units, beats and seconds, every one with its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import floor, inf

from ergon.instruments.model import Instrument, Module, Target
from ergon.notation.clock.meter import SAME, Meter
from ergon.notation.clock.occurrences import starts
from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables.strengths import MEZZO_FORTE, ImpulseRange, Level, Levels
from ergon.notation.tables.tuning import Tuning, tuning_of_path
from ergon.notation.text.values import Place
from ergon.scores.pattern.draws import Draws
from ergon.scores.pattern.pattern import Pattern, PlaceSequence
from ergon.scores.pattern.steps import PlaceBeats, entry_place_beats
from ergon.scores.pattern.values import Amount
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.digest_marks import OMIT_EMPTY, OMIT_NONE
from ergon.scores.reading.outputs import Accuracy, Mix, RenderSpec, Route
from ergon.scores.reading.playing import Coupling, Gesture, Key, Play, Player, TakeFile
from ergon.scores.reading.rhythms import Rhythm
from ergon.scores.reading.sweep_fields import Passing

_ROUNDING = 1e-9  # tolerance for rounding of a number of frames


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
class NoteGlide:
    """How a pitch wheel moves the pitch of an instrument: factors, each at a time after the
    beginning of a phrase.
    """

    target: Target
    points: tuple[tuple[Length, float], ...]


@dataclass(frozen=True, slots=True)
class Hit:
    """One strike of a melody: at a position, or at a time after the beginning of a phrase.

    A strength lies within the `impulse_range` [N·s] of what is struck.
    """

    at: Position | Length
    to: tuple[Target, ...]
    level: Level
    place: Place
    struck_text: str = ""  # the text as written
    # The largest random displacement, earlier or later.
    jitter: Length = field(default=Length(), metadata=OMIT_EMPTY)
    impulse_range: ImpulseRange | None = field(default=None, metadata=OMIT_EMPTY)
    duration: Length | None = field(default=None, metadata=OMIT_EMPTY)  # None: it has no end


@dataclass(frozen=True, slots=True, kw_only=True)
class Strikes:
    """Ergons that hit modules directly: for each target at a Poisson `rate` [Hz], or one per
    `every`.

    `levels` say how strongly, strengths within the `impulse_ranges` [N·s] of what is struck; or a
    `mass` [kg] arrives at a `speed` [m/s]. A melody has `hits`. With a `length` it is a phrase: it
    begins at `at` and again every `every`, as do a sweep and a path (`passing`).
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
    impulse_ranges: Mapping[str, ImpulseRange] = field(default_factory=dict, metadata=OMIT_EMPTY)
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
    def draw_key(self) -> str:
        """The name that keys the random draws of the strikes."""
        return f"strikes/{self.name}"

    def stop_beat(self, tempo: TempoMap) -> float | None:
        """The beat at which they end; None if nothing ends them. Raises TextError."""
        if self.span is not None:
            return tempo.after(tempo.resolve(self.at), self.span)
        return None if self.until is None else tempo.resolve(self.until)

    def beats(self, tempo: TempoMap) -> Sequence[float]:
        """Beats of strikes without a pattern: one, or one per `every`. Raises TextError."""
        begin_beat = tempo.resolve(self.at)
        if self.every is None:
            return [begin_beat]
        stop = self.stop_beat(tempo)
        return starts(tempo, begin_beat, Length(), every=self.every, times=self.times, until=stop)

    def rounds(self, tempo: TempoMap) -> list[float]:
        """Beats on which rounds begin: one for each time a phrase is played. Raises TextError."""
        if self.length is None:
            return [0.0]
        end_beat = None if self.until is None else tempo.resolve(self.until)
        begin, period, times = tempo.resolve(self.at), self.every, self.times
        return starts(tempo, begin, self.length, every=period, times=times, until=end_beat)

    def played_hits(
        self, piece: Piece, since_beat: float = -inf, before_beat: float = inf
    ) -> Iterator[tuple[float, int, Hit]]:
        """The strikes of a melody or a rhythm: beat, number and hit. Raises TextError.

        Strikes of a rhythm are those between two beats; of a melody all are.
        """
        tempo = piece.tempo_map
        if self.rhythm is not None:
            yield from self._rhythm_hits(piece, self.rhythm, since_beat, before_beat)
            return
        end_beat = inf if self.until is None or self.length else tempo.resolve(self.until) - SAME
        for round_index, round_start in enumerate(self.rounds(tempo)):
            for hit_index, hit in enumerate(self.hits):
                hit_position = hit.at
                hit_beat = (
                    tempo.resolve(hit_position)
                    if isinstance(hit_position, Position)
                    else tempo.after(round_start, hit_position)
                )
                if hit_beat < end_beat:
                    yield hit_beat, round_index * len(self.hits) + hit_index, hit

    def cycles(self, tempo: TempoMap, before_beat: float = inf) -> int:
        """The number of cycles of a rhythm that begin before a beat. Raises TextError."""
        assert self.rhythm is not None
        stop = self.stop_beat(tempo)
        n_cycles = self.rhythm.cycle_count(
            tempo, tempo.resolve(self.at), before_beat if stop is None else min(stop, before_beat)
        )
        return n_cycles if self.times is None else min(n_cycles, self.times)

    def _rhythm_hits(
        self, piece: Piece, rhythm: Rhythm, since_beat: float, before_beat: float
    ) -> Iterator[tuple[float, int, Hit]]:
        tempo, end_beat = piece.tempo_map, self.stop_beat(piece.tempo_map)
        before_beat = before_beat if end_beat is None else min(end_beat, before_beat)
        begin_beat = tempo.resolve(self.at)
        first_cycle = 0
        if since_beat != -inf:
            cycles_late, seconds_late = rhythm.latest_delay()
            early_beat = (
                tempo.after(since_beat, Length(seconds=-seconds_late))
                if seconds_late
                else since_beat
            )
            first_cycle = max(
                0, rhythm.cycle_count(tempo, begin_beat, early_beat) - 1 - cycles_late
            )
        cycles = range(first_cycle, self.cycles(tempo, before_beat))
        levels = self.levels or Levels((MEZZO_FORTE,))
        for stroke in rhythm.strokes(
            tempo, begin_beat, levels, (piece.seed, self.draw_key), cycles
        ):
            if not since_beat - SAME <= stroke.beat < before_beat - SAME:
                continue
            for targets, impulse_range in rhythm.voices[stroke.word]:
                lasting_length = Length(beats=stroke.duration)
                word, level = stroke.word, stroke.level
                hit = Hit(
                    Length(),
                    targets,
                    level,
                    self.place,
                    word,
                    impulse_range=impulse_range,
                    duration=lasting_length,
                )
                yield stroke.beat, stroke.number, hit

    def place_beats(self, piece: Piece) -> PlaceBeats:
        """The places of the pattern, on which it strikes. Raises TextError."""
        assert self.pattern is not None
        tempo = piece.tempo_map
        begin, stop = tempo.resolve(self.at), self.stop_beat(tempo)
        place_sequence = PlaceSequence(self.pattern, Draws(piece.seed, self.draw_key))
        return entry_place_beats(
            tempo, begin, place_sequence, step_length=self.every, times=self.times, end_beat=stop
        )


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
    def motion_step_frames(self) -> int:
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
        family_by_part = self.note_families()
        channels: dict[tuple[str, str], int] = {}
        routes = []
        for instrument in self.instruments.values():
            for instrument_output in instrument.outputs:
                name = family_by_part.get(instrument.name, instrument.name), instrument_output.name
                channel = channels.setdefault(name, len(channels) + 1)
                routes.append(
                    Route(
                        instrument.name,
                        instrument_output.name,
                        (channel,),
                        1.0,
                        None,
                        instrument_output.place,
                    )
                )
        return tuple(routes)

    def playable_instrument(self, name: str) -> Instrument | None:
        """The instrument of a name, or of its first note; also one that nothing plays yet."""
        first_part = self.families.get(name, (name,))[0]
        return self.instruments.get(first_part) or self.available.get(name)

    def tuning_of(self, path: str) -> Tuning | None:
        """The tuning of the notes of what a path names: of its instrument, or of the score."""
        return tuning_of_path(path, self.tunings, self.tuning)

    def note_families(self) -> dict[str, str]:
        """The instrument that each note belongs to, by the name of the note's part."""
        return {part: name for name, parts in self.families.items() for part in parts}
