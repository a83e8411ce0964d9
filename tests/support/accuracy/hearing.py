"""What is heard of the difference of two sounds, from the definitions in docs/numerics.md; nothing
of the planner takes part in it.
"""

from dataclasses import astuple, dataclass
from math import inf

import numpy as np

from ergon import _core
from ergon.workshop.lab.metrics import third_octaves
from ergon.workshop.lab.partials import strongest_partials

PITCH_UPTO = 5000.0  # [Hz]
BAND = 20.0  # [Hz] half the width of a partial
EDGE = 0.025  # [s] at either end that belongs to no partial
WEAKEST = 1e-4  # of the strongest partial [power]
STRAIGHT, FALLS = 0.1, 0.1  # [nepers] a decay's residual at most, and its fall at least
HIGHEST = 19e3  # centre of the highest third octave that counts [Hz]
HOP = 1e-3  # [s] over which power is taken
BEFORE = 0.05  # [s] that a stroke exceeds
RISE, QUIET = 4.0, 1e-4  # a stroke's power over that before, and over that of the loudest
LENGTH = 0.05  # [s] of a stroke
REACH, BEGUN = 0.01, 0.3  # [s] around a stroke, and the part of the energy there that begins it
WORST_DB = 100.0
PADDED = 3  # lengths of a sound that follow it
STILL = 1e-24  # of the loudest output [power]: rounding of a reference at rest
UNHEARD = 1e-8  # of the loudest output [power]: what an output at rest may have (-80 dB)


@dataclass(frozen=True)
class AudibleErrors:
    """Errors in the order of `_core.AudibleError`: cents, T60 [1], dB, twice s, dB."""

    cents: float = 0.0
    t60: float = 0.0
    third_octave_db: float = 0.0
    first_stroke_s: float = 0.0
    later_stroke_s: float = 0.0
    stroke_db: float = 0.0

    @property
    def excess(self) -> float:
        """The largest, as a multiple of what is allowed by ear."""
        pairs = zip(astuple(self), _core.JUST_NOTICEABLE, strict=True)
        return max(error / allowed for error, allowed in pairs)


def errors(y: np.ndarray, x: np.ndarray, rate: float) -> AudibleErrors:
    """The largest errors of any output of `y` against those of `x` (n_frames, n_out)."""
    if not np.isfinite(y).all():
        return AudibleErrors(*[inf] * len(astuple(AudibleErrors())))
    ours, theirs = (sound - sound.mean(axis=0) for sound in (y, x))
    loudest = max(_energy(exact) for exact in theirs.T)
    rows = [
        astuple(
            _errors_at_rest(sound, loudest)
            if _energy(exact) < STILL * loudest
            else _errors_of_output(sound, exact, rate)
        )
        for sound, exact in zip(ours.T, theirs.T, strict=True)
    ]
    return AudibleErrors(*(float(worst) for worst in np.max(rows, axis=0)))


def _errors_at_rest(y: np.ndarray, loudest: float) -> AudibleErrors:
    """Of an output whose exact motion is rounding: what moves there is heard beside the loudest."""
    is_heard_there = _energy(y) > UNHEARD * loudest
    return AudibleErrors(stroke_db=WORST_DB if is_heard_there else 0.0)


def _errors_of_output(y: np.ndarray, x: np.ndarray, rate: float) -> AudibleErrors:
    if len(x) <= 3.0 * EDGE * rate or np.abs(x).max() == 0.0:
        return AudibleErrors()
    return AudibleErrors(
        *_partials(y, x, rate),
        _third_octaves(y, x, rate),
        *_strokes(np.diff(y), np.diff(x), rate),
    )


def _partials(y: np.ndarray, x: np.ndarray, rate: float) -> tuple[float, float]:
    """Largest error of a pitch [cents], and of a T60 relative to itself, of strong partials."""
    peaks = strongest_partials(x, rate, window=_window(len(x), rate))
    bands = [(f, _band(y, f, rate), _band(x, f, rate)) for f in peaks]
    powers = [float(np.sum(np.abs(theirs) ** 2)) for _, _, theirs in bands]
    cents, decays = [0.0], [0.0]
    for (f, ours, theirs), power in zip(bands, powers, strict=True):
        if f > PITCH_UPTO or not power > WEAKEST * max(powers):
            continue
        weight = np.abs(theirs)
        t = np.arange(len(theirs)) / rate
        cents.append(
            1200.0 * abs(float(np.log2(max(1.0 + _drift(ours, theirs, rate) / f, 1e-300))))
        )
        levels, others = (np.log(np.maximum(np.abs(band), 1e-300)) for band in (theirs, ours))
        fall = np.polyfit(t, levels, 1, w=weight)
        rest = levels - np.polyval(fall, t)
        residual = np.sqrt(np.sum((weight * rest) ** 2) / np.sum(weight**2))
        slope, _ = np.polyfit(t, others, 1, w=weight)
        if residual < STRAIGHT and -fall[0] * t[-1] > FALLS and slope < 0.0:
            decays.append(abs(float(fall[0] / slope) - 1.0))
    return max(cents), max(decays)


def _drift(ours: np.ndarray, theirs: np.ndarray, rate: float) -> float:
    """How much higher a partial is [Hz]: the smaller of two estimates, in both of which an error of
    a pitch shows, and with the same sign.

    Where partials beat, a slip of the phase as the level dips upsets the slope of all of the phase,
    and a level that is off the mean turn from frame to frame (Miller and Rochwarger, 1972). Where
    noise lies in the band, one says higher and the other lower.
    """
    turned = ours * np.conj(theirs)
    t = np.arange(len(theirs)) / rate
    slope = float(np.polyfit(t, np.unwrap(np.angle(turned)), 1, w=np.abs(theirs))[0])
    turn = rate * float(np.angle(np.sum(turned[1:] * np.conj(turned[:-1]))))
    return 0.0 if slope * turn < 0.0 else min(slope, turn, key=abs) / (2.0 * np.pi)


def _window(n_frames: int, rate: float) -> np.ndarray:
    """A window that rises within EDGE and falls to the end: fast partials are strong only at the
    beginning.
    """
    n_rise = min(round(EDGE * rate), n_frames // 2)
    rise, fall = ((np.arange(n) + 0.5) / n for n in (n_rise, n_frames - n_rise))
    return np.concatenate([np.sin(0.5 * np.pi * rise) ** 2, np.cos(0.5 * np.pi * fall) ** 2])


def _band(x: np.ndarray, f: float, rate: float) -> np.ndarray:
    """The analytic signal of a partial, by a Gaussian in the spectrum, without its ends."""
    # Padded, because the beginning would follow the end.
    n_padded = 2 * len(x)
    spectrum = np.fft.fft(x, n_padded)
    frequency = np.fft.fftfreq(n_padded, 1.0 / rate)
    spectrum *= np.exp(-0.5 * ((frequency - f) / BAND) ** 2)
    n_edge = round(EDGE * rate)
    return np.fft.ifft(spectrum)[n_edge : len(x) - n_edge]


def _third_octaves(y: np.ndarray, x: np.ndarray, rate: float) -> float:
    """The largest difference among those that are heard in `x` [dB]; ends are faded out."""
    fade = np.ones(len(x))
    n_faded = len(x) // 4
    fade[-n_faded:] = np.cos(0.5 * np.pi * (np.arange(n_faded) + 0.5) / n_faded) ** 2
    # Padded, because low bands hold few bins of the sound alone.
    rest = np.zeros(PADDED * len(x))
    centres, ours = third_octaves(np.concatenate([y * fade, rest]), rate)
    _, theirs = third_octaves(np.concatenate([x * fade, rest]), rate)
    # A band that is narrower than a bin of the sound holds nothing.
    is_wide = centres * 0.23 * len(x) / rate >= 1.0
    counted = is_heard(centres, theirs) & (centres < HIGHEST) & is_wide
    return float(np.abs(ours - theirs)[counted].max(initial=0.0))


def is_heard(centres: np.ndarray, db: np.ndarray) -> np.ndarray:
    """Bands that are above what the others mask (Schroeder's spreading, Johnston's offset)."""
    d = _bark(centres)[:, None] - _bark(centres)[None, :] + 0.474
    spread = db[None, :] + 15.81 + 7.5 * d - 17.5 * np.sqrt(1.0 + d**2)
    np.fill_diagonal(spread, -np.inf)
    masked = 10.0 * np.log10(np.sum(10.0 ** (spread / 10.0), axis=1)) - 14.5 - _bark(centres)
    return (db > masked) & (db > db.max() - 60.0)


def _bark(f: np.ndarray) -> np.ndarray:
    """By Zwicker and Terhardt (1980), not by the formula that the engine has."""
    return 13.0 * np.arctan(0.76e-3 * f) + 3.5 * np.arctan((f / 7500.0) ** 2)


def _strokes(y: np.ndarray, x: np.ndarray, rate: float) -> tuple[float, float, float]:
    """Errors of the first stroke's beginning, of that of later ones [s], and of levels [dB]."""
    length, reach = round(LENGTH * rate), round(REACH * rate)
    begins = strokes(x, rate)
    is_dense = len(begins) * length > len(x)
    late, levels = [0.0], [0.0]
    for begin in begins[: 1 if is_dense else None]:
        ratio = _energy(y[begin : begin + length]) / _energy(x[begin : begin + length])
        around = slice(max(0, begin - reach), begin + reach)
        enough = BEGUN * _energy(x[around])
        instants = [
            int(np.searchsorted(np.cumsum(sound[around] ** 2), limit))
            for sound, limit in ((y, enough * ratio), (x, enough))
        ]
        late.append(abs(instants[0] - instants[1]) / rate)
        levels.append(_decibels(ratio))
    if is_dense:
        n_spans = len(x) // length
        ours, theirs = (
            np.sum(sound[: n_spans * length].reshape(n_spans, length) ** 2, axis=1)
            for sound in (y, x)
        )
        is_loud = theirs > QUIET * theirs.max()
        levels = [float(np.mean([_decibels(r) for r in ours[is_loud] / theirs[is_loud]]))]
    return late[min(1, len(late) - 1)], max(late[2:], default=0.0), max(levels)


def strokes(x: np.ndarray, rate: float) -> list[int]:
    """The frames where strokes begin in differences from frame to frame, to within a hop."""
    hop = round(HOP * rate)
    n_hops = len(x) // hop
    power = np.sum(x[: n_hops * hop].reshape(n_hops, hop) ** 2, axis=1)
    n_before = round(BEFORE / HOP)
    begins: list[int] = []
    for index in range(n_hops):
        before = power[max(0, index - n_before) : index].max(initial=0.0)
        is_stroke = power[index] > max(QUIET * power.max(), RISE * before)
        if is_stroke and (not begins or index > begins[-1] + n_before // 5):
            begins.append(index)
    return [index * hop for index in begins]


def _energy(x: np.ndarray) -> float:
    return float(np.sum(x**2))


def _decibels(ratio: float) -> float:
    if not ratio > 0.0:
        return WORST_DB
    return min(WORST_DB, abs(10.0 * float(np.log10(ratio))))
