"""Tables of resonances, as ModRes writes and Modalys reads them."""

from __future__ import annotations

from math import isfinite, pi
from pathlib import Path

from ergon.common.decay import LN_1000
from ergon.common.errors import ErgonError
from ergon.common.foreign_files import foreign_file
from ergon.common.regular import read_bounded

_LINES_MAX = 100_000  # characters of a line, and lines
_BYTES_MAX = 1 << 24  # largest file


class TableError(ErgonError):
    """A file that is not a table of resonances; the message says where and why."""


def read(path: Path) -> list[tuple[float, float, float]]:
    """f [Hz], t60 [s] and amplitude of each resonance.

    Lines are `index frequency amplitude bandwidth`, or without the index; lines that begin with
    ; or # are comments. Amplitudes are factors; if any is negative, all are in dB. A resonance
    with bandwidth b falls by 60 dB in 3·ln 10/(π·b). Raises TableError.
    """
    if (foreign_kind := foreign_file(path)) is not None:
        raise TableError(f"{path}: {foreign_kind}")
    try:
        content = read_bounded(path, _BYTES_MAX)
        if len(content) > _BYTES_MAX:
            raise TableError(f"{path}: it is larger than {_BYTES_MAX >> 20} MB")
        lines = content.decode("utf-8").splitlines()
    except UnicodeDecodeError:
        message = f"{path}: it is neither WAV, FLAC or AIFF nor a text; give a recorded stroke or "
        raise TableError(message + "a table of resonances") from None
    rows = []
    for line_number, line in enumerate(lines[:_LINES_MAX], 1):
        words = line[:_LINES_MAX].replace(",", " ").split()
        if not words or words[0][0] in ";#":
            continue
        rows.append(_parse_row(f"{path}:{line_number}", words))
    if not rows:
        raise TableError(f"{path}: it has no resonances; write lines such as 1 220.5 0.8 0.35")
    is_db = any(a < 0.0 for _, a, _ in rows)
    resonances = [(f, LN_1000 / (pi * b), 10.0 ** (a / 20.0) if is_db else a) for f, a, b in rows]
    audible = [row for row in resonances if row[2] > 0.0]
    if not audible:
        raise TableError(f"{path}: all amplitudes are 0, so that nothing sounds")
    return audible


def _parse_row(location: str, words: list[str]) -> tuple[float, float, float]:
    if not 3 <= len(words) <= 4:
        message = f"{location}: a line is an index, a frequency [Hz], an amplitude and a bandwidth "
        raise TableError(
            message + f"[Hz], such as 1 220.5 0.8 0.35; here it has {len(words)} words"
        )
    try:
        frequency, amplitude, bandwidth = (float(word) for word in words[-3:])
    except ValueError:
        raise TableError(f"{location}: {' '.join(words[-3:])} are not three numbers") from None
    if not (isfinite(frequency) and isfinite(amplitude) and isfinite(bandwidth)):
        raise TableError(f"{location}: {' '.join(words[-3:])} are not three finite numbers")
    if not 0.0 < frequency < 1e6:
        raise TableError(
            f"{location}: a frequency of {frequency:g} Hz; it must be above 0 and below 1 MHz"
        )
    if not bandwidth > 0.0:
        raise TableError(
            f"{location}: a bandwidth of {bandwidth:g} Hz; it must be above 0, or it never ends"
        )
    return frequency, amplitude, bandwidth
