"""The comparer tells gaps, wrong samples and missing ends apart."""

import numpy as np
import pytest
from captured import Gap, compare


@pytest.fixture
def sound() -> np.ndarray:
    return np.random.default_rng(7).random((4000, 3), dtype=np.float32) + 0.1


def test_compare_with_silence_before_and_after(sound):
    silence = np.zeros((500, 3), np.float32)
    result = compare(np.concatenate([silence, sound, silence]), sound)
    assert result.exact
    assert result.equal == 4000


def test_compare_with_silence_within_counts_gap(sound):
    silence = np.zeros((256, 3), np.float32)
    late = np.concatenate([sound[:1000], silence, sound[1000:]])
    assert compare(late, sound).gaps == (Gap(1000, 256, 0),)
    over = np.concatenate([sound[:1000], silence, sound[1256:]])
    assert compare(over, sound).gaps == (Gap(1000, 256, 256),)


def test_compare_with_faded_silence_counts_gap(sound):
    """As an output does that has no frames for a while."""
    rise = np.arange(1, 89, dtype=np.float32)[:, None] / np.float32(88)
    fall = sound[999] * rise[::-1]
    risen = sound[1000:1088] * rise
    silence = np.zeros((256, 3), np.float32)
    late = np.concatenate([sound[:1000], fall, silence, risen, sound[1088:]])
    result = compare(late, sound)
    assert result.wrong == result.unheard == 0
    (gap,) = result.gaps
    # The fall begins with the last frame, the rise ends with a frame as it was.
    assert gap == Gap(1000, 88 + 256 + 87, 87)


@pytest.mark.slow
def test_changed_sound_after_silence_counts_as_wrong(sound):
    other = np.concatenate([sound[:1000], np.zeros((256, 3), np.float32), sound[1000:] * 0.5])
    result = compare(other, sound)
    assert (result.gaps, result.wrong) == ((), 1000)


def test_compare_with_missing_frames_counts_gap(sound):
    result = compare(np.concatenate([sound[:1000], sound[1100:]]), sound)
    assert result.gaps == (Gap(1000, 0, 100),)
    assert result.equal == 3900
    assert result.wrong == result.unheard == 0


def test_compare_with_one_changed_bit_counts_wrong(sound):
    other = sound.copy()
    other[1234, 2] = np.nextafter(other[1234, 2], np.float32(2))
    result = compare(other, sound)
    assert (result.wrong, result.gaps, result.equal) == (1, (), 3999)


def test_missing_end_counts_as_unheard(sound):
    assert compare(sound[:3900], sound).unheard == 100
    assert compare(sound[:0], sound).unheard == 4000
