"""The moving picture on README.md: the score of docs/view.md as its page shows it.

python -m docs.generators.film docs/pictures/galaxy.webp
"""

from __future__ import annotations

import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import av

from docs.generators.pages import blocks, put
from docs.generators.sizes import report_size
from ergon.common.module_arguments import module_arguments

PAGE = Path(__file__).resolve().parents[1] / "view.md"
RATE = 15  # pictures a second
LARGEST = 3_000_000  # bytes
VIEW = (
    *("--size", "640x360", "--fps", str(RATE), "--from", "0.3s"),
    *("--camera", "1@0.3s 1@2s 2@3.2s"),
)


def draw(folder: Path) -> list[Path]:
    """Let a browser draw the pictures into a folder; their files, in order."""
    for block in blocks(PAGE):
        if block.language == "yaml":
            put(block, folder)
    command = [sys.executable, "-m", "ergon", "view", "galaxy.yaml", "--movie", "frames/", *VIEW]
    subprocess.run(command, cwd=folder, check=True)
    return sorted((folder / "frames").glob("*.png"))


def encode(pictures: list[Path], target: Path) -> None:
    """Write pictures as an animated WebP file that begins again at its end."""
    with av.open(str(target), "w", format="webp", options={"loop": "0"}) as film:
        stream = film.add_stream("libwebp_anim", rate=RATE, options={"quality": "70"})
        stream.width, stream.height, stream.pix_fmt = 640, 360, "yuv420p"
        for number, path in enumerate(pictures):
            with av.open(str(path)) as picture:
                frame = next(picture.decode(video=0)).reformat(format="yuv420p")
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            film.mux(stream.encode(frame))
        film.mux(stream.encode(None))


def main(target: Path) -> None:
    """Draw and write the film."""
    with TemporaryDirectory() as name:
        encode(draw(Path(name)), target)
    report_size(target, LARGEST)


if __name__ == "__main__":
    main(Path(module_arguments("FILE")[0]))
