"""When the places of a pattern begin: beats by number, computed on demand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from typing import overload

from ergon._core import poll
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.occurrences import MAX_OCCURRENCES
from ergon.notation.clock.positions import Length
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.errors import TextError
from ergon.scores.pattern.order import Leaf
from ergon.scores.pattern.pattern import PlaceSequence
from ergon.scores.pattern.rhythm import EVEN_SWING
from ergon.scores.pattern.search import first_index_from

_TOO_MANY_MESSAGE = f"the piece has more than {MAX_OCCURRENCES:,} occurrences of gestures"


class PlaceBeats(Sequence[float]):
    """Beats on which the places of a line begin, rests included.

    `places` says what is played there.
    """

    def __init__(
        self,
        places: PlaceSequence,
        beat: Callable[[int], float],
        count: int,
        make_beats: Callable[[PlaceSequence], PlaceBeats],
    ) -> None:
        """Take `count` places, each on the beat that `beat` gives; `last_beat` becomes the beat of
        the last one.

        `make_beats` makes the beats of another course.
        """
        self.places = places
        self.beat = beat
        self.last_beat = beat(count - 1) if count else -inf
        self._count = count
        self._make_beats = make_beats

    def with_seed(self, seed: int) -> PlaceBeats:
        """The same line with all chance derived from another seed."""
        places = self.places
        if places.draws.seed == seed:
            return self
        return self._make_beats(PlaceSequence(places.pattern, replace(places.draws, seed=seed)))

    def __len__(self) -> int:
        """How many places there are."""
        return self._count

    def excerpt_fields(
        self, first_place: int, stop_place: int, position_text: Callable[[float], str]
    ) -> dict[str, str | None]:
        """Fields of a line that has only the places from `first_place` to before `stop_place`, at
        the same beats.

        `position_text` writes a beat.
        """
        pattern = self.places.pattern
        fields = {
            "at": position_text(self[first_place]),
            "until": position_text(self.beat(stop_place)),
            "times": None,
        }
        n_skipped, euclid = pattern.skip + first_place, pattern.euclid
        if not n_skipped and euclid is not None:  # its first pulse may be later than its beginning
            rotate = (euclid.rotate + euclid.positions()[0]) % euclid.steps
            fields["euclid"] = f"{euclid.pulses} {euclid.steps} rotate {rotate}"
        return {**fields, "skip": str(n_skipped) if n_skipped else None}

    @overload
    def __getitem__(self, index: int) -> float: ...
    @overload
    def __getitem__(self, index: slice) -> list[float]: ...
    def __getitem__(self, place_index: int | slice) -> float | list[float]:
        """The beat of a place."""
        if isinstance(place_index, slice):
            return [self.beat(place) for place in range(*place_index.indices(self._count))]
        place_number = place_index + self._count if place_index < 0 else place_index
        if not 0 <= place_number < self._count:
            raise IndexError(place_index)
        return self.beat(place_number)


def entry_place_beats(
    tempo: TempoMap,
    begin_beat: float,
    places: PlaceSequence,
    *,
    step_length: Length | None = None,
    times: int | None = None,
    end_beat: float | None = None,
    length_of_name: Callable[[str], Length | None] = lambda name: None,
    places_left: int = MAX_OCCURRENCES,
) -> PlaceBeats:
    """The places of a line that begins on beat `begin_beat`, with one step per `step_length`.

    Without `step_length` a Euclidean rhythm lasts a bar, and plain names follow each other after
    their own length. Without `times` (rounds) and `end_beat` there is one round. `places_left` is
    how many more places the piece may have. Raises TextError.
    """
    poll()
    times = 1 if times is None and end_beat is None else times
    count_max = places_left + 1 if times is None else places.place_count(times)
    if count_max <= 0:
        raise TextError(f"'skip {places.pattern.skip}' leaves out every place of the pattern")
    if step_length is None and places.pattern.euclid is not None:
        step_length = Length(bars=1.0 / places.pattern.euclid.steps)
    if step_length is not None:
        if not step_length.is_some:
            raise TextError("'every' must be above 0")
        beat_of_place = _even_steps(tempo, begin_beat, places, step_length)
    else:
        beat_of_place = _consecutive_steps(
            tempo, begin_beat, places, length_of_name, min(count_max, places_left + 1), end_beat
        )
    if end_beat is not None:
        stop_beat = end_beat - SAME
        count_max = first_index_from(beat_of_place, min(count_max, places_left + 1), stop_beat)
    if count_max > places_left:
        raise TextError(_TOO_MANY_MESSAGE)

    def make_beats(other_places: PlaceSequence) -> PlaceBeats:
        return entry_place_beats(
            tempo,
            begin_beat,
            other_places,
            step_length=step_length,
            times=times,
            end_beat=end_beat,
            length_of_name=length_of_name,
            places_left=places_left,
        )

    return PlaceBeats(places, beat_of_place, count_max, make_beats)


def _even_steps(
    tempo: TempoMap, begin_beat: float, places: PlaceSequence, step_length: Length
) -> Callable[[int], float]:
    """Steps of the length `step_length`; if places are skipped, the first one that is left begins
    at `begin_beat`.
    """
    first_position = places.position(0) if places.pattern.skip else 0.0

    def beat(place: int) -> float:
        return tempo.after(begin_beat, step_length.times(places.position(place) - first_position))

    return beat


def _consecutive_steps(
    tempo: TempoMap,
    begin_beat: float,
    places: PlaceSequence,
    length_of_name: Callable[[str], Length | None],
    count_max: int,
    until_beat: float | None,
) -> Callable[[int], float]:
    """Each place begins when the gesture of the place before has ended."""
    pattern_order = places.pattern.order
    place_lengths = []
    for item in pattern_order.items:
        gesture_length = (
            length_of_name(item.name) if isinstance(item, Leaf) and item.name is not None else None
        )
        is_mixed = (
            pattern_order.way != "in turn"
            or places.shift_per_round
            or places.pattern.swing != EVEN_SWING
        )
        if is_mixed or gesture_length is None:
            raise TextError(
                "the length of a step is missing; write `every`, for instance every 1", code="E103"
            )
        place_lengths.append(gesture_length)
    if not any(length.is_some for length in place_lengths):
        raise TextError("the gestures have no duration; write `every`, for instance every 1")
    place_beats = [begin_beat]
    for place_index in range(count_max):
        if until_beat is not None and place_beats[-1] >= until_beat:
            break
        if not place_index % 1024:
            poll()
        length_index = (place_index + places.pattern.skip) % len(place_lengths)
        place_beats.append(tempo.after(place_beats[-1], place_lengths[length_index]))
    return lambda place: place_beats[place] if place < len(place_beats) else inf
