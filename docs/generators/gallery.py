"""The pictures and figures of `docs/gallery.md`: of all pieces on it, or of the named ones."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from docs.generators.spectra import spectrogram
from ergon.api.score import level_of
from ergon.cli.bundled import bundled_scores
from ergon.common.module_arguments import module_arguments
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

PAGE = Path(__file__).parents[1] / "gallery.md"
FOLDER = PAGE.with_suffix("")
_BLOCK = 65_536  # frames
_WINDOW = 4096
_LOWEST, _BRIGHT, _HIGHEST = 20.0, 2000.0, 16_000.0  # Hz
_LEVELS_S = 0.1  # of each level that dynamics are taken from


def drawn(path: Path) -> tuple[str, str]:
    """An SVG and a line of features, for the mean of all channels of a score played to its end."""
    loaded = load(path)
    if loaded.piece is None:
        raise ValueError(str(loaded.diagnostics))
    staged = stage(loaded.piece)
    level = level_of(loaded.piece, 24)
    mixer = staged.mixer(highpass=level.highpass, reference=level.reference)
    mixed_blocks = []
    for first in range(0, staged.n_frames, _BLOCK):
        n_frames = min(_BLOCK, staged.n_frames - first)
        frames = np.zeros((n_frames, staged.simulation.n_out))
        staged.simulation.process(frames)
        mixed = np.zeros((n_frames, staged.n_channels))
        mixer.process(frames, mixed)
        mixed_blocks.append(mixed.mean(axis=1))
    sound = np.concatenate(mixed_blocks)
    picture = spectrogram(sound[None, :], staged.rate, loaded.piece.title or path.stem)
    return picture, features(sound, staged.rate, loaded.piece.render.tail)


def features(sound: NDArray[np.float64], rate: float, tail: float) -> str:
    """One line with the length, spectral centroid, level above 2 kHz and dynamics of a sound."""
    window = np.hanning(_WINDOW)
    power = sum(
        np.abs(np.fft.rfft(sound[first : first + _WINDOW] * window)) ** 2
        for first in range(0, len(sound) - _WINDOW, _WINDOW // 2)
    )
    f = np.fft.rfftfreq(_WINDOW, 1 / rate)
    in_range = (f >= _LOWEST) & (f < _HIGHEST)
    centre = float(np.sum(f[in_range] * power[in_range]) / np.sum(power[in_range]))
    above = 10 * np.log10(np.sum(power[in_range & (f > _BRIGHT)]) / np.sum(power[in_range]))
    wide = int(_LEVELS_S * rate)
    n_levels = int((len(sound) / rate - tail) / _LEVELS_S)
    levels = np.sqrt(np.mean(sound[: n_levels * wide].reshape(n_levels, wide) ** 2, axis=1))
    soft, loud = 20 * np.log10(np.percentile(levels, [10, 95]) + 1e-30)
    return (
        f"{len(sound) / rate:.0f} s; centre of the spectrum {centre:,.0f} Hz, "
        f"{_level_text(above)} above 2 kHz; "
        f"{loud - soft:.0f} dB from soft to loud."
    )


def _level_text(level: float) -> str:
    return f"{level:.0f} dB".replace("-", "\N{MINUS SIGN}")


def main() -> None:
    """Play the pieces, write their pictures, and put the measurements under each."""
    FOLDER.mkdir(exist_ok=True)
    pieces = bundled_scores()
    page = PAGE.read_text(encoding="utf-8")
    shown = re.findall(r"\(gallery/(.+)\.svg\)", page)
    for name in module_arguments(rest_metavar="PIECE") or shown:
        picture, line = drawn(pieces[name])
        (FOLDER / f"{name}.svg").write_text(picture, encoding="utf-8")
        below = re.compile(rf"(\(gallery/{name}\.svg\)\n\n)(?:\d+ s; centre .+\n\n)?")
        page = below.sub(lambda found, line=line: f"{found[1]}{line}\n\n", page)
        PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
