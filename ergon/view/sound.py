"""A rendered sound as a picture: its waveform above, its spectrogram below.

numpy's FFT is allowed here, because no result becomes a sample of sound.
"""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Iterable
from typing import TYPE_CHECKING

from .curve import Axis, Curve, axis
from .svg import Frame, axes, document, shorten, text

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_WIDTH, _LEFT, _RIGHT, _WAVE_HEIGHT, _SPECTRUM_HEIGHT, _SPECTRUM_ROWS = 800, 64, 784, 130, 220, 220
_FREQUENCY_MIN = 20.0  # [Hz] below it nothing is heard
_RANGE_DB = 90.0  # [dB] from the loudest to paper
_WINDOW_FRAMES = 4096  # frames: 11 Hz and 93 ms at 44.1 kHz shows partials and strokes alike
# Silence is white and loud is dark. Five colours of viridis, the last for the loudest.
_COLOURS = ((255, 255, 255), (183, 222, 74), (38, 164, 133), (49, 92, 140), (68, 1, 84))


def picture(blocks: Iterable[NDArray[np.float64]], n_frames: int, rate: float, title: str) -> str:
    """SVG of the mean of all channels; `blocks` are (n, n_channels), `n_frames` in all."""
    import numpy as np

    mono = _mono(blocks, n_frames)
    t_axis = axis((0.0, len(mono) / rate), 8, tight=True)
    peak = float(np.max(np.abs(mono))) or 1.0
    wave_frame = Frame(_LEFT, 36, _RIGHT, 36 + _WAVE_HEIGHT, t_axis, axis((-peak, peak), 3))
    spectrum_top = wave_frame.bottom + 36
    spectrum_frame = Frame(
        _LEFT,
        spectrum_top,
        _RIGHT,
        spectrum_top + _SPECTRUM_HEIGHT,
        t_axis,
        _frequency_axis(rate / 2),
    )
    image_base64 = base64.b64encode(png(_colour_pixels(_spectrogram(mono, rate)))).decode()
    elements = [
        axes(wave_frame, "", "mean of channels"),
        _waveform_path(mono, wave_frame),
        axes(spectrum_frame, "time [s]", "frequency [Hz]"),
        f"<image x='{_LEFT}' y='{spectrum_top:g}' width='{_RIGHT - _LEFT}' "
        f"height='{_SPECTRUM_HEIGHT}' preserveAspectRatio='none' "
        f"href='data:image/png;base64,{image_base64}'/>",
        text(_LEFT, 22, shorten(title), weight="bold"),
        text(_RIGHT, 22, f"spectrogram: {_RANGE_DB:g} dB down to white", anchor="end"),
    ]
    return document(_WIDTH, int(spectrum_frame.bottom) + 48, title, elements)


def envelope(
    blocks: Iterable[NDArray[np.float64]], n_frames: int, rate: float, n_points: int = 600
) -> tuple[Curve, Curve]:
    """Highest and lowest sample of the mean of all channels, in `n_points` sections."""
    import numpy as np

    mono = _mono(blocks, n_frames)
    edges = np.linspace(0, len(mono), min(n_points, len(mono)) + 1).astype(int)[:-1]
    t = (edges / rate).tolist()
    return (
        Curve("highest", t, np.maximum.reduceat(mono, edges).tolist()),
        Curve("lowest", t, np.minimum.reduceat(mono, edges).tolist()),
    )


def _mono(blocks: Iterable[NDArray[np.float64]], n_frames: int) -> NDArray[np.float64]:
    import numpy as np

    channel_mean = np.zeros(max(n_frames, 1))
    begin = 0
    for block in blocks:
        channel_mean[begin : begin + len(block)] = block.mean(axis=1)
        begin += len(block)
    return channel_mean


def png(pixels: NDArray[np.uint8]) -> bytes:
    """A PNG file of (height, width, 3) pixels (ISO/IEC 15948), red, green and blue."""
    pixel_height, pixel_width, _ = pixels.shape
    pixel_rows = b"".join(b"\0" + row.tobytes() for row in pixels)  # filter 0 before every row

    def chunk(name: bytes, content: bytes) -> bytes:
        checksum = zlib.crc32(name + content)
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", checksum)

    header = struct.pack(">IIBBBBB", pixel_width, pixel_height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(pixel_rows, 9))
        + chunk(b"IEND", b"")
    )


def _frequency_axis(frequency_max: float) -> Axis:
    """A logarithmic axis of frequency, with ticks at round frequencies."""
    import math

    tick_frequencies = (20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000)
    ticks = [f for f in tick_frequencies if _FREQUENCY_MIN <= f <= frequency_max]
    labels = tuple(f"{f // 1000}k" if f >= 1000 else str(f) for f in ticks)
    log_ticks = tuple(math.log10(f) for f in ticks)
    return Axis(math.log10(_FREQUENCY_MIN), math.log10(frequency_max), log_ticks, 0, labels)


def _waveform_path(mono: NDArray[np.float64], frame: Frame) -> str:
    """The lowest and highest sample of every pixel column, as one closed shape."""
    import numpy as np

    n_columns = _RIGHT - _LEFT
    edges = np.linspace(0, len(mono), n_columns + 1).astype(int)
    upper_points, lower_points = [], []
    for column in range(n_columns):
        column_samples = mono[edges[column] : max(edges[column + 1], edges[column] + 1)]
        x = _LEFT + column + 0.5
        upper_points.append(f"{x:g} {frame.y_pixel(float(column_samples.max())):.1f}")
        lower_points.append(f"{x:g} {frame.y_pixel(float(column_samples.min())):.1f}")
    points = "L".join(upper_points + lower_points[::-1])
    return f"<path d='M{points}Z' fill='#0072b2' stroke='#0072b2' stroke-width='0.5'/>"


def _spectrogram(mono: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
    """Level from 0, _RANGE_DB below the loudest, to 1, (_SPECTRUM_ROWS, n_columns), highest
    frequency first.
    """
    import numpy as np

    n_columns = _RIGHT - _LEFT
    padded = np.concatenate((np.zeros(_WINDOW_FRAMES // 2), mono, np.zeros(_WINDOW_FRAMES)))
    window = np.hanning(_WINDOW_FRAMES)
    row_edge_bins = (
        np.geomspace(rate / 2, _FREQUENCY_MIN, _SPECTRUM_ROWS + 1) / rate * _WINDOW_FRAMES
    )
    power = np.empty((_SPECTRUM_ROWS, n_columns))
    for column in range(n_columns):
        begin = int((column + 0.5) / n_columns * len(mono))
        power_spectrum = np.abs(np.fft.rfft(padded[begin : begin + _WINDOW_FRAMES] * window)) ** 2
        for row in range(_SPECTRUM_ROWS):
            # The bins within the pixel, or the nearest two if a pixel is narrower than a bin.
            first_bin, end_bin = (
                int(row_edge_bins[row + 1]),
                int(np.ceil(row_edge_bins[row])),
            )
            power[row, column] = power_spectrum[first_bin : max(end_bin, first_bin + 1)].max()
    peak_power = power.max()
    if peak_power <= 0:
        return np.zeros_like(power)
    power_floor = 10 ** (-_RANGE_DB / 10)
    levels: NDArray[np.float64] = (
        1 + 10 * np.log10(np.maximum(power / peak_power, power_floor)) / _RANGE_DB
    )
    return levels


def _colour_pixels(levels: NDArray[np.float64]) -> NDArray[np.uint8]:
    import numpy as np

    colour_levels = np.linspace(0, 1, len(_COLOURS))
    channels = [
        np.interp(levels, colour_levels, [c[index] for c in _COLOURS]) for index in range(3)
    ]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)
