"""One stroke in a recording: where it begins, and whether it is a single stroke."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ergon.common.errors import ErgonError
from ergon.common.report import Report
from ergon.exchange import sound as sound_files
from ergon.exchange.wave_header import NotWaveError
from ergon.workshop.bells.bands import Array

ANALYSED_DURATION_MAX = 30.0  # [s] of a stroke that are analysed
_SAMPLES_MAX = 1 << 27  # of a file, all channels: 1 GB
_DURATION_MIN = 0.1  # [s]
_ATTACK_DURATION = 0.004  # [s] from its beginning to what is analysed: the stroke itself is over
_SOFT_ATTACK_DURATION = 0.03  # [s] of a soft stroke
_SILENT_PEAK = 1e-6  # peak of full scale
_CLIPPED_RUN_MIN, _CLIPPED_RUNS_MIN = 3, 3  # samples at the peak in a row; how often
_CLIPPED_TOLERANCE = 1e-4  # relative to the peak
_FRAME, _HOP = 1024, 256
_BANDS = 24
_SECOND_STROKE_RATIO = 4.0  # rise of power within two hops that is a second stroke
_HOPS_BEFORE = 12  # hops that it is compared with, after a gap of _GAP_HOPS
_GAP_HOPS = 2
_STRUCK_BAND_SHARE = 0.5  # share of the sounding bands
_SOUNDING_RATIO_MIN = 100.0  # power over that of a band's quietest hop


class NotAStrokeError(ErgonError):
    """A sound that is not a recording of one stroke; the message says why."""


@dataclass(frozen=True)
class Stroke:
    """The sound after a stroke (n,) at `rate` [Hz]; it begins `delay` [s] after the middle of the
    push.
    """

    name: str
    sound: Array
    rate: float
    delay: float


def read(path: Path, report: Report | None = None) -> tuple[Array, float]:
    """The loudest channel of a sound file (n,), and its rate [Hz].

    Raises NotAStrokeError and OSError.
    """
    try:
        return _loudest_channel(path, report or Report())
    except NotWaveError as error:
        raise NotAStrokeError(f"{path}: {error}") from None


def _loudest_channel(path: Path, report: Report) -> tuple[Array, float]:
    wave_info = sound_files.read_info(path)
    if wave_info.damage is not None:
        report.warn(f"{path}: {wave_info.damage}")
    if wave_info.n_frames * wave_info.format.n_channels > _SAMPLES_MAX:
        n_channels = wave_info.format.n_channels
        message = f"{path}: it has {wave_info.n_frames:,} frames of {n_channels} channels; "
        raise NotAStrokeError(message + "cut the stroke out of it")
    blocks = list(sound_files.read_blocks(path))
    if not blocks:
        raise NotAStrokeError(f"{path}: it has no samples")
    samples = np.concatenate(blocks)
    samples = samples.reshape(len(samples), -1)
    if not np.isfinite(samples).all():
        raise NotAStrokeError(f"{path}: it has samples that are not numbers")
    loudest = int(np.argmax(np.sum(samples * samples, axis=0)))
    return np.ascontiguousarray(samples[:, loudest]), float(wave_info.format.rate)


def stroke(name: str, sound: Array, rate: float) -> Stroke:
    """The one stroke of a sound. Raises NotAStrokeError."""
    peak = float(np.abs(sound).max(initial=0.0))
    if peak < _SILENT_PEAK:
        raise NotAStrokeError(f"{name}: it is silent; record a stroke")
    sound = sound - sound.mean()
    onset_frame = _onset_frame(sound, rate)
    audible = sound[onset_frame : onset_frame + round(ANALYSED_DURATION_MAX * rate)]
    if audible.size < _DURATION_MIN * rate:
        message = f"{name}: only {1e3 * audible.size / rate:.0f} ms follow its stroke; record "
        raise NotAStrokeError(message + "until it has died away, 100 ms at least")
    _refuse_clipped(name, audible)
    _refuse_steady(name, audible)
    _refuse_second(name, audible, rate)
    loudest = int(np.argmax(np.abs(audible[: round(_SOFT_ATTACK_DURATION * rate)]))) + round(
        0.001 * rate
    )
    n_skipped = max(
        round(_ATTACK_DURATION * rate), min(loudest, round(_SOFT_ATTACK_DURATION * rate))
    )
    # The middle of a soft push is shortly before the loudest sample, not where the push begins.
    # Extrapolated to its beginning, quickly decaying modes would be hundreds of dB louder.
    return Stroke(name, audible[n_skipped:], rate, min(n_skipped / rate, _ATTACK_DURATION))


def _onset_frame(sound: Array, rate: float) -> int:
    """The first sample of the stroke, within 1 ms."""
    n_window = max(1, round(0.001 * rate))
    power = np.convolve(sound * sound, np.full(n_window, 1.0 / n_window))[: sound.size]
    return max(0, int(np.argmax(power > 0.01 * power.max())) - n_window // 2)


def _refuse_clipped(file_name: str, sound: Array) -> None:
    for signed_sound in (sound, -sound):
        is_peak = signed_sound > (1.0 - _CLIPPED_TOLERANCE) * signed_sound.max()
        run_edges = np.flatnonzero(np.diff(np.concatenate([[0], is_peak.astype(int), [0]])))
        run_lengths = run_edges[1::2] - run_edges[::2]
        if int(np.sum(run_lengths >= _CLIPPED_RUN_MIN)) >= _CLIPPED_RUNS_MIN:
            n_clipped = int(np.sum(run_lengths >= _CLIPPED_RUN_MIN))
            message = (
                f"{file_name}: it is clipped: {n_clipped} times it stays at its peak; record softer"
            )
            raise NotAStrokeError(message)


def _refuse_steady(file_name: str, sound: Array) -> None:
    parts = np.array_split(sound, 4)
    powers = [float(np.mean(part * part)) for part in parts]
    if powers[-1] > 0.5 * max(powers):
        message = f"{file_name}: it does not die away: its last quarter is as loud as the others; "
        raise NotAStrokeError(message + "a stroke is needed, recorded until it is quiet")


def _refuse_second(file_name: str, sound: Array, rate: float) -> None:
    """Refuse a second stroke: it raises most partials at once, whereas beats raise single partials,
    slowly.
    """
    n_hops = (sound.size - _FRAME) // _HOP
    if n_hops < 2 * (_HOPS_BEFORE + _GAP_HOPS):
        return
    windows = np.lib.stride_tricks.sliding_window_view(sound, _FRAME)[::_HOP][:n_hops]
    spectra = np.abs(np.fft.rfft(windows * np.hanning(_FRAME), axis=1)) ** 2
    band_edges = np.unique(np.geomspace(2, _FRAME // 2, _BANDS + 1).astype(int))
    band_powers = np.add.reduceat(spectra, band_edges[:-1], axis=1)
    noise = np.percentile(band_powers, 5, axis=0)
    first_hop = 2 * _GAP_HOPS + _HOPS_BEFORE
    for hop in range(first_hop, n_hops):
        peaks_before = band_powers[hop - _GAP_HOPS - _HOPS_BEFORE : hop - _GAP_HOPS].max(axis=0)
        is_sounding = (band_powers[hop] > _SOUNDING_RATIO_MIN * noise) & (
            band_powers[hop] > 1e-6 * band_powers.max()
        )
        is_struck = is_sounding & (band_powers[hop] > _SECOND_STROKE_RATIO * peaks_before)
        is_loud = band_powers[hop] > 1e-4 * band_powers[hop].max()
        if (
            is_struck.sum() >= 3
            and (is_struck & is_loud).sum() > _STRUCK_BAND_SHARE * (is_loud).sum()
        ):
            time = hop * _HOP / rate
            message = f"{file_name}: something strikes again {time:.2f} s after the first stroke; "
            raise NotAStrokeError(message + "cut the recording before it")
