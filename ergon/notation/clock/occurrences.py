"""When a play begins: `at`, `every`, `times`, `until` become starting beats.

Without `every` an occurrence begins where the one before ends, final hold included. Without `times`
and `until` there is one. No occurrence begins at `until` or later; with both, the first to end the
series ends it.
"""

import re
from math import ceil

from ergon._core import poll
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.errors import TextError

MAX_OCCURRENCES = 1_000_000  # in a piece


def parse_times(times_text: str) -> int:
    """Read a number of repetitions. Raises TextError."""
    times_word = times_text.strip()
    if not re.fullmatch(r"[0-9]{1,7}", times_word) or not 1 <= int(times_word) <= MAX_OCCURRENCES:
        raise TextError(
            f"'{times_word[:40]}' is not a number of repetitions from 1 to {MAX_OCCURRENCES:,}",
            length=max(1, len(times_text)),
        )
    return int(times_word)


def starts(
    tempo: TempoMap,
    start_beat: float,
    gesture_length: Length,
    *,
    every: Length | None = None,
    times: int | None = None,
    until: float | None = None,
    room: int = MAX_OCCURRENCES,
) -> list[float]:
    """Beats of the piece on which the occurrences of a gesture of `gesture_length` begin, from beat
    `start_beat`.

    `room` is how many more occurrences the piece may hold. Raises TextError if there would be
    more, or if the time between two occurrences is 0.
    """
    poll()
    if times in (None, 1) and until is None and room > 0:
        return [start_beat]  # most lines of a part play once
    step_length = gesture_length if every is None else every
    if times is None and until is None:
        times = 1
    if times != 1 and not step_length.is_some:
        raise TextError(
            "the gesture has no duration; write the time between repetitions, such as every: 1"
            if every is None
            else "'every' must be above 0"
        )
    count_max = room + 1 if times is None else times
    stop_beat = float("inf") if until is None else until - SAME
    is_mixed = (
        sum(
            part != 0.0
            for part in (
                step_length.bars,
                step_length.beats,
                step_length.seconds,
                step_length.quarters,
            )
        )
        > 1
    )
    # This is quick, because a session repeats without end: thousands of occurrences.
    if step_length.beats and not is_mixed:
        n_starts = min(count_max, room)
        if stop_beat < start_beat + step_length.beats * n_starts:
            n_starts = max(0, ceil((stop_beat - start_beat) / step_length.beats))
        elif count_max > room:
            raise TextError(f"the piece has more than {MAX_OCCURRENCES:,} occurrences of gestures")
        return [start_beat + step_length.beats * index for index in range(n_starts)]
    start_beats: list[float] = []
    next_beat = start_beat
    while len(start_beats) < count_max and next_beat < stop_beat:
        if len(start_beats) == room:
            raise TextError(f"the piece has more than {MAX_OCCURRENCES:,} occurrences of gestures")
        if not len(start_beats) % 1024:
            poll()
        start_beats.append(next_beat)
        # Each start is counted from `start_beat`, so rounding does not accumulate. A step of mixed
        # units is counted from the start before it, because its size depends on meter and tempo
        # there.
        next_beat = (
            tempo.after(next_beat, step_length)
            if is_mixed
            else tempo.after(start_beat, step_length.times(len(start_beats)))
        )
    return start_beats
