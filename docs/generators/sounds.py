"""The sounds that README.md links to, as scores render them: ten seconds each, as Ogg Vorbis.

python -m docs.generators.sounds docs/sounds
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import soundfile
from numpy.typing import NDArray

import ergon
from docs.generators.pages import blocks, put
from docs.generators.sizes import report_size
from ergon.cli.bundled import bundled_scores
from ergon.common.module_arguments import module_arguments

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 10
FADE = 0.5  # [s] at the end, for a piece may go on there
LARGEST = 200_000  # bytes of a file
QUALITY = 0.6  # of soundfile's compression, from 0 (largest) to 1
# The name of a file, and the score: of a page, or one that ships.
SOUNDS: Mapping[str, str] = {
    "first": "README.md",
    "change-ringing": "",
    "interlocking": "",
}


def rendered(name: str) -> tuple[NDArray[np.float64], int]:
    """The first seconds of a sound (n_frames, n_channels), and its rate [Hz]."""
    with TemporaryDirectory() as folder:
        page = SOUNDS[name]
        if page:
            score = _score_of_page(ROOT / page, f"{name}.yaml", Path(folder))
        else:
            score = Path(bundled_scores()[name])
        sound = ergon.render(score, ergon.RenderOptions(until=f"{SECONDS}s"))
    frames = sound.frames[: round(SECONDS * sound.rate)].copy()
    n_fade = round(FADE * sound.rate)
    frames[-n_fade:] *= np.cos(np.linspace(0, np.pi / 2, n_fade))[:, None] ** 2
    return frames, round(sound.rate)


def _score_of_page(page: Path, name: str, folder: Path) -> Path:
    for block in blocks(page):
        if block.language == "yaml":
            put(block, folder)
    return folder / name


def main(folder: Path) -> None:
    """Write each sound into a folder."""
    folder.mkdir(exist_ok=True)
    for name in SOUNDS:
        frames, rate = rendered(name)
        path = folder / f"{name}.ogg"
        soundfile.write(path, frames, rate, format="OGG", compression_level=QUALITY)
        report_size(path, LARGEST)


if __name__ == "__main__":
    main(Path(module_arguments("FOLDER")[0]))
