"""Numbers as people read them: lengths, levels, sizes, durations."""

from __future__ import annotations

import math


def metres_text(length_metres: float) -> str:
    """A length with three digits in the unit that suits it."""
    for factor, unit in ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm")):
        if abs(length_metres) >= factor:
            return f"{length_metres / factor:.3g} {unit}"
    return "0 mm"  # nothing that a hand or a loudspeaker does is smaller than a nanometre


def decibels(ratio: float) -> float:
    """Level of a ratio of amplitudes [dB]; -inf for silence. For reading, never for samples."""
    return 20 * math.log10(ratio) if ratio > 0 else -math.inf


# Loudness is that of blocks of this length [s] above the absolute gate [LUFS]: ITU-R BS.1770-4.
_LOUDNESS_BLOCK, _LOUDNESS_GATE = 0.4, -70.0


def level_text(value: float, unit: str) -> str:
    """`-1.0 dBFS`; silence says so."""
    return "silent" if value == -math.inf else f"{value:.1f} {unit}"


def loudness_of(loudness_lufs: float, peak: float, duration: float) -> str:
    """`-18.2 LUFS` of a sound with a `peak` (ratio) and a duration [s], or why it has none."""
    if loudness_lufs > -math.inf or peak == 0.0:
        return level_text(loudness_lufs, "LUFS")
    if duration < _LOUDNESS_BLOCK:
        return f"not measured (shorter than {_LOUDNESS_BLOCK:g} s)"
    return f"below {_LOUDNESS_GATE:g} LUFS"


def seconds_text(duration_seconds: float) -> str:
    """`33.5 s` or `4 min 07 s`."""
    if duration_seconds < 120:
        return f"{duration_seconds:.3g} s"
    return f"{int(duration_seconds // 60)} min {int(duration_seconds % 60):02} s"


def octets_text(byte_count: float) -> str:
    """`3.1 MB`, in powers of ten as disks are sold."""
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if byte_count < 1000 or unit == "TB":
            return f"{byte_count:.0f} {unit}" if unit == "bytes" else f"{byte_count:.1f} {unit}"
        byte_count /= 1000
    raise AssertionError
