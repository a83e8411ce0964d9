"""Comparison of captured with expected sound: gaps are distinguished from wrong samples."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# A match needs this many equal samples, in at least this many frames, so that it is not an
# accident.
SURE_SAMPLES, SURE_FRAMES = 64, 3
# An output that gets no frames fades to silence, and from it, within 2 ms [frames].
SHAPED = 96
# The comparison ends after this many wrong frames, because each is searched for in a second of
# sound.
WRONG_FRAMES_MAX = 1000


@dataclass(frozen=True)
class Gap:
    """At `frame` of the expected sound: `silent` frames were inserted, `lost` frames are
    missing.
    """

    frame: int
    silent: int
    lost: int


@dataclass(frozen=True)
class Comparison:
    """`equal` + `wrong` + the frames lost in gaps + `unheard` = expected frames."""

    equal: int
    wrong: int
    gaps: tuple[Gap, ...]
    unheard: int  # the end that was not captured

    @property
    def exact(self) -> bool:
        """Every frame came, in order, bit for bit."""
        return not (self.wrong or self.gaps or self.unheard)


def compare(captured: NDArray, expected: NDArray, *, reach: int = 48000) -> Comparison:
    """Align both on their first frame that is not silent.

    A gap is all silence found there (a busy machine makes it seconds long), and at most `reach`
    frames left out.
    """
    captured, expected = _begun(captured), _begun(expected)
    sounding = np.flatnonzero(captured.any(axis=1))
    position = to = equal = wrong = 0
    gaps: list[Gap] = []
    while to < len(expected) and position < len(captured) and wrong < WRONG_FRAMES_MAX:
        n = min(len(expected) - to, len(captured) - position)
        differ = np.flatnonzero(
            (captured[position : position + n] != expected[to : to + n]).any(axis=1)
        )
        same = int(differ[0]) if len(differ) else n
        position, to, equal = position + same, to + same, equal + same
        if not len(differ):
            break
        gap = _gap(captured, sounding, position, expected[to : to + reach], to)
        if gap is None:
            position, to, wrong = position + 1, to + 1, wrong + 1
        else:
            gaps.append(gap)
            position, to = position + gap.silent, to + gap.lost
    return Comparison(equal, wrong, tuple(gaps), len(expected) - to)


def check_heard(captured: NDArray, expected: NDArray, troubles: Iterable[str]) -> Comparison:
    """Assert that the captured sound is the expected one except for the reported gaps.

    The sound in the ring at the end is not heard. On a busy machine the ring runs empty.
    """
    result = compare(captured[: -4 * 1024], expected)
    output = [int(one.split()[1]) for one in troubles if one.startswith("gaps ")]
    assert result.wrong == 0, result
    assert len(result.gaps) <= max(output, default=0), result
    return result


def _begun(frames: NDArray) -> NDArray:
    sounding = np.flatnonzero(frames.any(axis=1))
    return frames[sounding[0] :] if len(sounding) else frames[:0]


def _gap(
    captured: NDArray, sounding: NDArray, position: int, expected: NDArray, frame: int
) -> Gap | None:
    """Inserted silence, frames left out, or both; None if the sound does not continue after it."""
    falls = np.flatnonzero(~captured[position : position + SHAPED].any(axis=1))
    after = np.searchsorted(sounding, position + int(falls[0]) if len(falls) else position)
    if after == len(sounding):
        return None
    silent = int(sounding[after]) - position
    sure = max(SURE_FRAMES, -(-SURE_SAMPLES // captured.shape[1]))
    for rise in range(SHAPED + 1 if silent else 1):
        behind = captured[position + silent + rise : position + silent + rise + sure]
        if len(behind) < sure:
            break
        # The first frame is searched everywhere, the others only where the first is found.
        for lost in np.flatnonzero((expected == behind[0]).all(axis=1)):
            there = expected[lost : lost + sure]
            if np.array_equal(there, behind) and (silent or lost):
                return Gap(frame, silent + rise, int(lost))
    return None
