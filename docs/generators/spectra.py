"""Small spectrograms for pages: sounds beside each other, from 40 Hz to 18 kHz."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ergon.view.curve import Axis, axis
from ergon.view.svg import Frame, axes, document, text

_WIDTH, _LEFT, _TOP, _HEIGHT, _BETWEEN = 640, 48, 28, 160, 10
_LOWEST, _HIGHEST, _ROWS = 40.0, 18_000.0, 112
_WINDOW = 2048
_RANGE = 72.0  # dB from the loudest to paper
_STEPS = 13  # shades: few, so that the file is small
_COLOURS = ((255, 255, 255), (183, 222, 74), (38, 164, 133), (49, 92, 140), (68, 1, 84))
_TICKS = (50, 100, 200, 500, 1000, 2000, 5000, 10_000)


def spectrogram(
    sounds: NDArray[np.float64], rate: float, title: str, names: Sequence[str] = ("",)
) -> str:
    """SVG of sounds (n_sounds, n_frames), each in its own frame, with levels relative to its own
    loudest.
    """
    n_sounds, n_frames = sounds.shape
    room = _WIDTH - _LEFT - 12 - _BETWEEN * (n_sounds - 1)
    across = room // n_sounds
    logs = tuple(np.log10(_TICKS).tolist())
    labels = tuple(f"{f // 1000}k" if f >= 1000 else str(f) for f in _TICKS)
    pitch = Axis(np.log10(_LOWEST), np.log10(_HIGHEST), logs, 0, labels)
    bare = Axis(pitch.low, pitch.high, (), 0)
    seconds = axis((0.0, n_frames / rate), 3 if n_sounds > 1 else 10, tight=True)
    parts = []
    for i, sound in enumerate(sounds):
        left = _LEFT + i * (across + _BETWEEN)
        frame = Frame(left, _TOP, left + across, _TOP + _HEIGHT, seconds, pitch if i == 0 else bare)
        image = base64.b64encode(_png(_shades(sound, rate, across // 2))).decode()
        parts += [
            axes(frame, "time [s]" if i == 0 else "", "Hz" if i == 0 else ""),
            f"<image x='{left}' y='{_TOP}' width='{across}' height='{_HEIGHT}' "
            f"preserveAspectRatio='none' href='data:image/png;base64,{image}'/>",
            text(left + across, _TOP - 8, names[i], anchor="end"),
        ]
    parts.append(text(_LEFT, 18, title, weight="bold"))
    return document(_WIDTH, _TOP + _HEIGHT + 44, title, parts)


def _shades(x: NDArray[np.float64], rate: float, n_columns: int) -> NDArray[np.uint8]:
    """Shades (_ROWS, n_columns) from 0 (white) to the loudest; highest frequency first."""
    padded = np.concatenate((np.zeros(_WINDOW // 2), x, np.zeros(_WINDOW)))
    starts = ((np.arange(n_columns) + 0.5) / n_columns * len(x)).astype(int)
    window = np.hanning(_WINDOW)
    pieces = np.lib.stride_tricks.sliding_window_view(padded, _WINDOW)[starts]
    power = np.abs(np.fft.rfft(pieces * window, axis=1)) ** 2
    edges = np.geomspace(_HIGHEST, _LOWEST, _ROWS + 1) / rate * _WINDOW
    rows = []
    for high, low in pairwise(edges):
        first = int(low)
        rows.append(power[:, first : max(int(np.ceil(high)), first + 1)].max(axis=1))
    levels = 10 * np.log10(np.array(rows) / (power.max() or 1.0) + 1e-12)
    shades: NDArray[np.uint8] = np.rint(np.clip(1 + levels / _RANGE, 0, 1) * (_STEPS - 1)).astype(
        np.uint8
    )
    return shades


def _png(shades: NDArray[np.uint8]) -> bytes:
    """A PNG file of shades by a palette, four bits each (ISO/IEC 15948)."""
    height, width = shades.shape
    padded = np.pad(shades, ((0, 0), (0, width % 2)))
    packed = (padded[:, ::2] << 4 | padded[:, 1::2]).astype(np.uint8)
    rows = b"".join(b"\0" + row.tobytes() for row in packed)
    positions = np.linspace(0, 1, len(_COLOURS))
    palette = bytes(
        round(float(np.interp(step / (_STEPS - 1), positions, [c[i] for c in _COLOURS])))
        for step in range(_STEPS)
        for i in range(3)
    )

    def chunk(name: bytes, content: bytes) -> bytes:
        check = zlib.crc32(name + content)
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", check)

    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 4, 3, 0, 0, 0))
        + chunk(b"PLTE", palette)
        + chunk(b"IDAT", zlib.compress(rows, 9))
        + chunk(b"IEND", b"")
    )
