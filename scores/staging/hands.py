"""Puts what players play on the timeline, as gestures, each occurrence at its instant."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, TypedDict, cast, overload

from ergon import _core
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.occurrences import starts
from ergon.notation.clock.positions import Length, Position
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.values import Place, Point, Time
from ergon.scores.gesture.points import Curve
from ergon.scores.gesture.transforms import Chance, MidpointChance, Transform, apply, apply_to_take
from ergon.scores.pattern.search import n_before
from ergon.scores.pattern.steps import PlaceBeats
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import (
    DEFAULT_OPTIONS,
    NO_OPTIONS,
    Gesture,
    Play,
    Player,
    PlayingOptions,
)
from ergon.scores.staging.not_over import UnfinishedLines
from ergon.scores.staging.takes import Takes

_RANDOM_TRANSFORMS = ("jitter",)  # transformations that each occurrence draws anew

# The most that is put on a timeline: 1.4 kB for each occurrence, and 0.1 kB for each of its points.
OCCURRENCES_MAX = 200_000
MAX_POINTS = 750_000
# Steps of work for a place of a pattern, an occurrence, and each of its points.
_PLACE_STEPS, _OCCURRENCE_STEPS, _POINT_STEPS = 1_000, 10_000, 500


class _EngineOptions(TypedDict):
    touch: Literal["open", "tracked"]
    ergons: Literal["event", "particle"]
    grain: float | None
    join: float
    force_limit: float | None
    layer: bool


class StagedGesture(NamedTuple):  # there may be a million: a tuple is made four times as fast
    """One occurrence of a gesture or take on a key; instants in seconds of the piece.

    `written_start` is the instant of its beat, from which its points are counted.
    """

    name: str
    player: str
    key: str
    key_index: int
    struck_mat: int
    start: float
    stop: float
    place: Place
    # The points of this occurrence: instants [s] and positions [m].
    instants: Sequence[float] = ()
    positions: Sequence[float] = ()
    curves: tuple[Curve, ...] = ()  # the ways into them
    is_layer: bool = False
    is_tracked: bool = False
    written_start: float = 0.0

    @property
    def throw_indices(self) -> tuple[int, ...]:
        """Indices of the points that are reached by a throw."""
        if "throw" not in self.curves:
            return ()
        return tuple(i for i, curve in enumerate(self.curves) if i and curve == "throw")


class ErgonPlaces(Sequence[Place]):
    """Places in the score by the number that each ergon carries; they are computed on demand."""

    def __init__(self) -> None:
        """Start without places."""
        self._places: list[Callable[[], Place]] = []

    def add(self, place: Callable[[], Place]) -> int:
        """Add a place; returns its number."""
        self._places.append(place)
        return len(self._places) - 1

    @overload
    def __getitem__(self, index: int) -> Place: ...
    @overload
    def __getitem__(self, index: slice) -> list[Place]: ...
    def __getitem__(self, ergon_index: int | slice) -> Place | list[Place]:
        """The place of a number."""
        if isinstance(ergon_index, slice):
            return [place() for place in self._places[ergon_index]]
        return self._places[ergon_index]()

    def __len__(self) -> int:
        """How many numbers there are."""
        return len(self._places)


@dataclass(frozen=True, slots=True)
class _ShapedGesture:
    """A written gesture on its key, relative to its start."""

    key: str
    times: list[Time]
    positions: Sequence[float]
    curves: tuple[Curve, ...]
    point_sources: list[int]
    options: _EngineOptions


class Window(NamedTuple):
    """The part of a piece that is played: occurrences that begin on beats `since_beat` ≤ beat <
    `until_beat`, and end after the instant `after_instant` [s].
    """

    since_beat: float = -math.inf
    until_beat: float = math.inf
    after_instant: float = -math.inf


ALL_TIME = Window()


LineAndBeats = tuple[Play, Sequence[float] | None]  # a line, and the beats on which it plays


def _key_name(piece: Piece, play: Play) -> str:
    return piece.players[play.player].key


def _last_beat(line: LineAndBeats) -> float:
    """The last beat on which a line plays; infinite if that is not known."""
    _, beats = line
    if isinstance(beats, PlaceBeats):
        return beats.last_beat
    return beats[-1] if type(beats) is list and beats else math.inf


def _name_and_count(line: LineAndBeats) -> tuple[tuple[str, str], int] | None:
    """What a line plays, and how often; None for patterns, which draw by place."""
    play, beats = line
    if isinstance(beats, PlaceBeats):
        return None
    return (play.player, play.played_text), len(beats or ())


@dataclass(slots=True)
class Hands:
    """Puts plays on the timeline of the engine."""

    piece: Piece
    timeline: _core.Timeline
    takes: Takes
    collector: Collector
    window: Window = ALL_TIME
    ergon_places: ErgonPlaces = field(default_factory=ErgonPlaces)
    gestures: list[StagedGesture] = field(default_factory=list)
    _key_and_mat_by_name: dict[str, tuple[int, int]] = field(default_factory=dict)
    _occurrence_counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    _point_sources: dict[tuple[str, int], int] = field(default_factory=dict)
    _shapes: dict[tuple[object, ...], _ShapedGesture] = field(default_factory=dict)
    _known_options: dict[tuple[str, str], _EngineOptions] = field(default_factory=dict)
    _played_counts: Counter[str] = field(default_factory=Counter)

    def add_key(self, name: str, struck_mat: int) -> None:
        """Add a key, by the MAT that ergons strike."""
        self._key_and_mat_by_name[name] = self.timeline.key(name, struck_mat), struck_mat

    def for_piece(self, piece: Piece, window: Window) -> Hands:
        """Hands that put what another piece plays on the same timeline and keys."""
        return Hands(
            piece,
            self.timeline,
            self.takes.for_piece(piece),
            self.collector,
            window,
            self.ergon_places,
            self.gestures,
            self._key_and_mat_by_name,
            _played_counts=self._played_counts,
        )

    def play_parts(
        self,
        piece: Piece,
        excluded_keys: Container[str] = (),
        known_lines: UnfinishedLines[LineAndBeats] | None = None,
    ) -> None:
        """Put all occurrences of the lines of a piece on the timeline, except on the keys
        `excluded_keys`.

        Lines that end before the window only advance the counts from which chance draws;
        `known_lines` remembers them where no key is still.
        """
        since = self.window.since_beat - SAME
        player_parts, starts = piece.parts, piece.starts
        if excluded_keys:
            remaining_lines = [
                line_and_beats
                for line_and_beats in zip(player_parts, starts, strict=True)
                if _key_name(piece, line_and_beats[0]) not in excluded_keys
            ]
            player_parts, starts = (
                tuple(line_and_beats for line_and_beats, _ in remaining_lines),
                tuple(beats for _, beats in remaining_lines),
            )
        unfinished_lines = known_lines or UnfinishedLines[LineAndBeats]()
        lines_left, counts = unfinished_lines.select(
            (player_parts, starts), since, lambda line: _last_beat(line) < since, _name_and_count
        )
        self._occurrence_counts.update(cast(dict[tuple[str, str], int], counts))
        for play, beats in lines_left:
            self.play(play, beats)

    def play(self, play: Play, starts: Sequence[float] | None) -> None:
        """Put all occurrences of one line of a part on the timeline, on the rising beats `starts`.

        Without `starts` the line is a take that repeats end to end.
        """
        if self._key_of(play) not in self._key_and_mat_by_name:
            return  # the piece of the stage lacks this key
        if isinstance(starts, PlaceBeats):
            self._play_pattern(play, starts.with_seed(self.piece.seed))
        elif (gesture := self.piece.gestures.get(play.played_text)) is not None:
            transforms = (*gesture.do, *play.do)
            for start_beat in self._starts_with_room(
                play, self._starts_within(play, starts or ()), len(gesture.points)
            ):
                self._put_gesture(play, gesture, transforms, start_beat)
        elif (take := self.takes.get(play.played_text)) is not None:
            start_beats = self._starts_within(
                play, self._take_beats(play, take) if starts is None else starts
            )
            for start_beat in self._starts_with_room(play, start_beats):
                self._put_take(play, take, start_beat)

    def _play_pattern(self, line: Play, steps: PlaceBeats) -> None:
        """Put what a pattern plays in its places within the window on the timeline."""
        places = steps.places
        since_beat, until_beat = self.window.since_beat - SAME, self.window.until_beat - SAME
        if steps.last_beat < since_beat:
            return
        first_place, stop_place = (n_before(steps, since_beat), n_before(steps, until_beat))
        plays_by_key: dict[tuple[str, tuple[Transform, ...]], Play] = {}
        due_plays: list[tuple[Play, float, int]] = []
        for place_index in range(first_place, stop_place):
            if not place_index % 1024:
                _core.poll(_PLACE_STEPS * 1024)
            if (played_name := places.played_name(place_index)) is not None:
                play_key = played_name, places.transforms(place_index)
                if play_key not in plays_by_key:
                    plays_by_key[play_key] = replace(
                        line, played_text=played_name, do=(*line.do, *play_key[1]), pattern=None
                    )
                due_plays.append((plays_by_key[play_key], steps[place_index], place_index))
        for play in plays_by_key.values():
            start_beats = [start for due_play, start, _ in due_plays if due_play is play]
            gesture = self.piece.gestures.get(play.played_text)
            if (
                not self._starts_with_room(play, start_beats, len(gesture.points) if gesture else 1)
                and start_beats
            ):
                return
        for play, start_beat, place_index in due_plays:
            if (gesture := self.piece.gestures.get(play.played_text)) is not None:
                transforms = (*gesture.do, *play.do)
                chance = places.draws.transforms(place_index + places.pattern.skip)
                self._put_gesture(play, gesture, transforms, start_beat, chance)
            elif (take := self.takes.get(play.played_text)) is not None:
                self._put_take(play, take, start_beat)

    def _starts_within(self, play: Play, starts: Sequence[float]) -> Sequence[float]:
        """The starts within the window; those before it are counted, because chance draws by
        number.
        """
        if self.window is ALL_TIME:
            return starts
        n_skipped = bisect_left(starts, self.window.since_beat - SAME)
        self._occurrence_counts[play.player, play.played_text] += n_skipped
        return starts[n_skipped : bisect_left(starts, self.window.until_beat - SAME)]

    def _starts_with_room(
        self, play: Play, starts: Sequence[float], n_points: int = 1
    ) -> Sequence[float]:
        """The starts, if the timeline has room for them; none if an error was reported."""
        _core.poll(len(starts) * (_OCCURRENCE_STEPS + _POINT_STEPS * n_points))
        self._played_counts["occurrences"] += len(starts)
        self._played_counts["points"] += len(starts) * n_points
        for counted_noun, n_max in (("occurrences", OCCURRENCES_MAX), ("points", MAX_POINTS)):
            if self._played_counts[counted_noun] > n_max:
                if self._played_counts["reports"]:
                    return ()
                self._played_counts["reports"] += 1
                message = (
                    f"{quote(play.played_text)}: with these {len(starts):,} × {n_points:,} points "
                    f"the piece plays more than {n_max:,} {counted_noun}"
                    if n_points > 1
                    else f"{quote(play.played_text)}: with these {len(starts):,} occurrences "
                    f"the piece plays more than {n_max:,} {counted_noun}"
                )
                help_text = "play the gesture less often, or write a long movement as a take"
                self.collector.error("E105", message, play.place, help=help_text)
                return ()
        return starts

    def play_standin(self, player: Player) -> None:
        """Play a live hand's stand-in from the beginning of the piece."""
        name, place = str(player.standin), player.place
        play = Play(
            player.name, name, Position(), None, 1, None, (), PlayingOptions(), place, place, None
        )
        self.play(play, (0.0,))

    def _take_beats(self, play: Play, take: _core.Take) -> list[float]:
        """Beats on which a take begins if it repeats end to end."""
        tempo = self.piece.tempo_map
        begin_beat = tempo.resolve(play.at)
        until_beat = None if play.until is None else tempo.resolve(play.until)
        take_shape = apply_to_take(play.do, 60.0 / tempo.bpm(begin_beat))
        take_seconds = (
            take.duration - take_shape.front_cut - take_shape.back_cut
        ) * take_shape.stretch
        length = Length(0.0, take_shape.shift.beats, take_shape.shift.seconds + take_seconds)
        try:
            return starts(tempo, begin_beat, length, times=play.times, until=until_beat)
        except TextError as error:
            self.collector.error("E305", f"{quote(play.played_text)}: {error.message}", play.place)
            return []

    def _put_gesture(
        self,
        part_play: Play,
        gesture: Gesture,
        transforms: tuple[Transform, ...],
        start_beat: float,
        chance: Chance | None = None,
    ) -> None:
        shape = self._known_shape(part_play, gesture, transforms, start_beat, chance)
        tempo = self.piece.tempo_map
        instants = [gesture.instant(tempo, start_beat, time) for time in shape.times]
        if instants[-1] <= self.window.after_instant:
            return
        key_index, struck_mat = self._key_and_mat_by_name[shape.key]
        try:
            self.timeline.gesture(
                key_index,
                instants,
                shape.positions,
                shape.curves,
                sources=shape.point_sources,
                **shape.options,
            )
        except _core.EngineError as error:
            point_index = min(error.index or 0, len(shape.point_sources) - 1)
            self.collector.error(
                "E308",
                f"{quote(part_play.played_text)}: {error.sentence}",
                self.ergon_places[shape.point_sources[point_index]],
                help=f"{part_play.player} plays the gesture at {part_play.place}",
            )
            return
        self.gestures.append(
            StagedGesture(
                part_play.played_text,
                part_play.player,
                shape.key,
                key_index,
                struck_mat,
                instants[0],
                instants[-1],
                part_play.place,
                array("d", instants),  # a quarter of the memory of a list
                shape.positions,
                shape.curves,
                shape.options["layer"],
                shape.options["touch"] == "tracked",
                tempo.seconds(start_beat),
            )
        )

    def _known_shape(
        self,
        play: Play,
        gesture: Gesture,
        transforms: tuple[Transform, ...],
        start: float,
        chance: Chance | None,
    ) -> _ShapedGesture:
        """A gesture as it is played from a beat on; kept for further occurrences if nothing in it
        is random.

        Without a `chance` of its own it draws by the number of its occurrence.
        """
        player_and_gesture = play.player, play.played_text
        occurrence_number = self._occurrence_counts[player_and_gesture]
        self._occurrence_counts[player_and_gesture] += chance is None
        if transforms and any(transform.word in _RANDOM_TRANSFORMS for transform in transforms):
            if chance is None:
                name = f"{play.player}/{play.played_text}"
                chance = _core.Chance(self.piece.seed, "parts", name, 0, occurrence_number)
            return self._make_shape(play, gesture, transforms, start, chance)
        playing_options = None if play.options is NO_OPTIONS else play.options
        beat = gesture.beat(self.piece.tempo_map, start) if transforms else 0.0
        shape_key = (*player_and_gesture, play.do, playing_options, beat)
        if shape_key not in self._shapes:
            self._shapes[shape_key] = self._make_shape(
                play, gesture, transforms, start, MidpointChance()
            )
        return self._shapes[shape_key]

    def _make_shape(
        self,
        part_play: Play,
        gesture: Gesture,
        transforms: tuple[Transform, ...],
        start_beat: float,
        chance: Chance,
    ) -> _ShapedGesture:
        gesture_points: Sequence[Point] = gesture.points
        if transforms:
            gesture_points, _ = apply(
                gesture_points, transforms, chance, gesture.beat(self.piece.tempo_map, start_beat)
            )
        key_reach = self._key_reach(part_play)
        return _ShapedGesture(
            self._key_of(part_play),
            [point.at for point in gesture_points],
            array("d", [point.x * key_reach for point in gesture_points]),
            tuple(cast(Curve, point.curve) for point in gesture_points),
            [self._point_source(gesture, point) for point in gesture_points],
            self._line_options(part_play, gesture),
        )

    def _line_options(self, part_play: Play, gesture: Gesture) -> _EngineOptions:
        """The options by which a line plays a gesture; lines without options of their own share one
        object.
        """
        if part_play.options is not NO_OPTIONS:
            return self._engine_options(
                part_play,
                part_play.options.with_defaults(gesture.options).with_defaults(DEFAULT_OPTIONS),
            )
        options_key = part_play.player, gesture.name
        if options_key not in self._known_options:
            self._known_options[options_key] = self._engine_options(
                part_play, gesture.options.with_defaults(DEFAULT_OPTIONS)
            )
        return self._known_options[options_key]

    def _put_take(self, part_play: Play, take: _core.Take, start_beat: float) -> None:
        tempo = self.piece.tempo_map
        take_shape = apply_to_take(part_play.do, 60.0 / tempo.bpm(start_beat))
        begin = tempo.instant(start_beat, take_shape.shift)
        stop = (
            begin
            + (take.duration - take_shape.front_cut - take_shape.back_cut) * take_shape.stretch
        )
        if stop <= self.window.after_instant:
            return
        take_options = self._engine_options(
            part_play, part_play.options.with_defaults(DEFAULT_OPTIONS)
        )
        key_index, struck_mat = self._key_and_mat_by_name[self._key_of(part_play)]
        try:
            if take_shape.front_cut or take_shape.back_cut:
                take = take.part(take_shape.front_cut, take.duration - take_shape.back_cut)
            self.timeline.take(
                key_index,
                take,
                begin,
                scale=take_shape.scale * self._key_reach(part_play),
                stretch=take_shape.stretch,
                reverse=take_shape.reverse,
                source=self.ergon_places.add(lambda: part_play.place),
                **take_options,
            )
        except _core.EngineError as error:
            self.collector.error(
                "E308", f"{quote(part_play.played_text)}: {error.sentence}", part_play.place
            )
            return
        self.gestures.append(
            StagedGesture(
                part_play.played_text,
                part_play.player,
                self._key_of(part_play),
                key_index,
                struck_mat,
                begin,
                stop,
                part_play.place,
                is_layer=take_options["layer"],
                is_tracked=take_options["touch"] == "tracked",
                written_start=tempo.seconds(start_beat),
            )
        )

    def _engine_options(self, play: Play, gesture_options: PlayingOptions) -> _EngineOptions:
        force_limit = gesture_options.force_limit
        option_values = {
            "touch": gesture_options.touch,
            "ergons": gesture_options.ergons,
            "grain": gesture_options.grain,
            "join": gesture_options.join,
            # Behind a lever the piece sees s·x, and forces divided by s.
            "force_limit": None if force_limit is None else force_limit / self._key_reach(play),
            "layer": gesture_options.layer,
        }
        return cast(_EngineOptions, option_values)  # DEFAULT_OPTIONS has all options

    def _point_source(self, gesture: Gesture, point: Point) -> int:
        source_key = gesture.name, point.offset
        if source_key not in self._point_sources:
            self._point_sources[source_key] = self.ergon_places.add(lambda: gesture.place_of(point))
        return self._point_sources[source_key]

    def _key_of(self, play: Play) -> str:
        return self.piece.players[play.player].key

    def _key_reach(self, play: Play) -> float:
        return self.piece.keys[self._key_of(play)].reach
