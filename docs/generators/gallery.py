"""The pictures of `docs/gallery.md`: a spectrogram of each piece on it, or of those named."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
from docs.generators.spectra import spectrogram

from ergon.cli.demo import bundled
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

PAGE = Path(__file__).parents[1] / "gallery.md"
FOLDER = PAGE.with_suffix("")
_BLOCK = 65_536  # frames


def draw(path: Path) -> str:
    """SVG of the mean of all channels of a score, played to its end."""
    loaded = load(path)
    if loaded.piece is None:
        raise ValueError(str(loaded.diagnostics))
    staged = stage(loaded.piece)
    mixer = staged.mixer(highpass=8.0)
    heard = []
    for first in range(0, staged.n_frames, _BLOCK):
        n_frames = min(_BLOCK, staged.n_frames - first)
        frames = np.zeros((n_frames, staged.simulation.n_out))
        staged.simulation.process(frames)
        mixed = np.zeros((n_frames, staged.n_channels))
        mixer.process(frames, mixed)
        heard.append(mixed.mean(axis=1))
    title = loaded.piece.title or path.stem
    return spectrogram(np.concatenate(heard)[None, :], staged.rate, title)


def main() -> None:
    """Play the pieces and write their pictures."""
    FOLDER.mkdir(exist_ok=True)
    pieces = bundled()
    shown = re.findall(r"\(gallery/(.+)\.svg\)", PAGE.read_text(encoding="utf-8"))
    for name in sys.argv[1:] or shown:
        (FOLDER / f"{name}.svg").write_text(draw(pieces[name]), encoding="utf-8")


if __name__ == "__main__":
    main()
