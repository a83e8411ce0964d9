"""What the audit hears of the difference of two sounds, where that difference is known."""

import numpy as np
import pytest
from accuracy import hearing

RATE = 44_100.0


def partial(f: float, t60: float, size: float = 1.0, seconds: float = 0.3) -> np.ndarray:
    t = np.arange(round(seconds * RATE)) / RATE
    return (size * np.exp(-6.91 * t / t60) * np.sin(2.0 * np.pi * f * t))[:, None]


def stroke(time: float, size: float = 1.0) -> np.ndarray:
    """A partial of 500 Hz that is struck at `time` [s] of 0.3 s."""
    sound = np.zeros((round(0.3 * RATE), 1))
    n = round(time * RATE)
    sound[n:] = partial(500.0, 0.2, size)[: len(sound) - n]
    return sound


def test_errors_of_equal_sounds():
    sound = partial(440.0, 0.5)
    assert hearing.errors(sound, sound, RATE) == hearing.AudibleErrors()
    silence = np.zeros_like(sound)
    assert hearing.errors(silence, silence, RATE) == hearing.AudibleErrors()


def test_errors_of_a_partial_in_pitch_and_decay():
    errors = hearing.errors(partial(441.0, 0.5), partial(440.0, 0.52), RATE)
    assert errors.cents == pytest.approx(1200.0 * np.log2(441.0 / 440.0), rel=0.02)
    assert errors.t60 == pytest.approx(0.52 / 0.5 - 1.0, rel=0.15)


def test_errors_of_third_octaves_audible_and_masked():
    # An abrupt beginning would be heard in all of them.
    rise = np.sin(np.linspace(0.0, 0.5 * np.pi, round(0.3 * RATE)))[:, None] ** 2
    low, high = rise * partial(440.0, 0.5), rise * partial(3000.0, 0.5, 0.1)
    other = hearing.errors(low + 2.0 * high, low + high, RATE)
    assert other.third_octave_db == pytest.approx(6.02, abs=0.1)
    near = rise * partial(520.0, 0.5, 0.003)
    assert hearing.errors(low + 1.3 * near, low + near, RATE).third_octave_db < 0.1


def test_errors_of_strokes_late_and_louder():
    reference = stroke(0.02) + stroke(0.15)
    late = hearing.errors(stroke(0.021) + stroke(0.153), reference, RATE)
    assert late.first_stroke_s == pytest.approx(1e-3, abs=2e-4)
    assert late.later_stroke_s == pytest.approx(3e-3, abs=4e-4)
    louder = hearing.errors(stroke(0.02) + stroke(0.15, 1.1), reference, RATE)
    assert louder.stroke_db == pytest.approx(0.83, abs=0.1)


def test_errors_of_non_finite_sound():
    sound = partial(440.0, 0.5)
    assert hearing.errors(sound * np.nan, sound, RATE).excess == np.inf


def test_errors_of_beating_partials():
    """Where two beat, a level that is off turns the phase of both to and fro: the pitch stays."""
    errors = hearing.errors(
        partial(440.0, 0.5) + partial(455.0, 0.5, 0.7),
        partial(440.0, 0.5) + partial(455.0, 0.5, 0.8),
        RATE,
    )
    assert errors.cents < 1.0


def test_errors_of_fast_fading_partial():
    low = partial(110.0, 0.35)
    errors = hearing.errors(low + partial(451.3, 0.05), low + partial(450.0, 0.05), RATE)
    assert errors.cents == pytest.approx(1200.0 * np.log2(451.3 / 450.0), rel=0.1)


def test_errors_of_an_output_at_rest():
    sound = partial(440.0, 0.5)
    exact = np.hstack([sound, 1e-15 * partial(300.0, 0.5)])
    rounding = np.hstack([sound, 1e-6 * partial(200.0, 0.5)])
    assert hearing.errors(rounding, exact, RATE) == hearing.AudibleErrors()
    moving = np.hstack([sound, 1e-2 * partial(200.0, 0.5)])
    assert hearing.errors(moving, exact, RATE).excess > 1.0
