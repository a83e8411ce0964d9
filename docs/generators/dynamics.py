"""The table of `docs/pieces.md`: how loud the concert pieces are, and how far from soft to loud.

python -m docs.generators.dynamics [PIECE ...]

Without a name all pieces of the table are rendered, which takes minutes.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import ergon
from ergon import _core
from ergon.cli.bundled import bundled_scores
from ergon.common.module_arguments import module_arguments
from ergon.rendering.loudness import GatedLoudness
from ergon.scores.reading.load import load

PAGE = Path(__file__).parents[1] / "pieces.md"
PIECES = (
    "change-ringing", "interlocking", "evening-raga", "workshop",
    "rain", "near-and-far", "three-breaths", "night-piece", "procession",
)  # fmt: skip
_PASSAGE_S = 3.0  # of short-term loudness (EBU Tech 3341)
_BLOCK_S, _STEP_S = 0.4, 0.1  # of momentary loudness, and from one to the next
_AUDIBLE = -60.0  # [LUFS]: softer passages do not count as played
_GATE, _RELATIVE, _LOW, _HIGH = -70.0, -20.0, 10, 95  # of the loudness range (EBU Tech 3342)


class Dynamics(NamedTuple):
    """Loudness [LUFS], true peak [dBTP], loudness range [LU], softest and loudest 3 s [LUFS]."""

    loudness: float
    true_peak: float
    loudness_range: float
    softest: float
    loudest: float

    @property
    def span(self) -> float:
        """From the softest passage to the loudest [LU]."""
        return self.loudest - self.softest


def dynamics(frames: NDArray[np.float64], rate: float, tail: float) -> Dynamics:
    """The dynamics of frames (n_frames, n_channels) at `rate` [Hz].

    Passages that reach into the last `tail` seconds, where only the last stroke dies away, count
    for the loudness range alone.
    """
    blocks = GatedLoudness(rate, frames.shape[1])
    blocks.take(frames)
    peak = _core.TruePeak(frames.shape[1])
    peak.process(np.ascontiguousarray(frames))
    passages = short_term(np.array(blocks.block_levels))
    played = passages[: max(1, len(passages) - round(tail / _STEP_S))]
    played = played[played > _AUDIBLE]
    return Dynamics(
        blocks.loudness(1.0),
        float(20.0 * np.log10(peak.peak)),
        loudness_range(passages),
        float(played.min()),
        float(played.max()),
    )


def short_term(momentary: NDArray[np.float64]) -> NDArray[np.float64]:
    """Loudness of 3 s at every 100 ms [LUFS]: the mean power of the 400 ms blocks inside."""
    inside = round((_PASSAGE_S - _BLOCK_S) / _STEP_S) + 1
    power = np.convolve(10.0 ** (momentary[3:] / 10.0), np.full(inside, 1.0 / inside), "valid")
    return 10.0 * np.log10(np.maximum(power, 1e-30))


def loudness_range(passages: NDArray[np.float64]) -> float:
    """The loudness range of short-term loudness [LUFS] in LU (EBU Tech 3342)."""
    gated = passages[passages > _GATE]
    mean = 10.0 * np.log10(np.mean(10.0 ** (gated / 10.0)))
    low, high = np.percentile(gated[gated > mean + _RELATIVE], [_LOW, _HIGH])
    return float(high - low)


def piece_dynamics(name: str) -> tuple[float, Dynamics]:
    """The length [s] of a bundled piece, and its dynamics."""
    score = bundled_scores()[name]
    piece = load(score).piece
    assert piece is not None, f"{name} is refused"
    sound = ergon.render(score)
    tail = piece.render.tail
    assert tail != "auto", f"{name} does not say when its last stroke is over"
    measured = dynamics(sound.frames, sound.rate, tail)
    return len(sound.frames) / sound.rate, measured


def row(name: str, seconds: float, measured: Dynamics) -> str:
    """A row of the table, without its last cells, which the page keeps."""
    cells = [
        f"{seconds:.0f} s", f"{measured.loudness:.1f}", f"{measured.true_peak:.1f}",
        f"{measured.loudness_range:.0f}", f"{measured.softest:.0f}", f"{measured.loudest:.0f}",
        f"{measured.span:.0f}",
    ]  # fmt: skip
    cells = [cell.replace("-", "\N{MINUS SIGN}") for cell in cells]
    return f"| `{name}` | {' | '.join(cells)} |"


def main() -> None:
    """Render the pieces, and write each row."""
    for name in module_arguments(rest_metavar="PIECE") or PIECES:
        line = row(name, *piece_dynamics(name))
        page = PAGE.read_text(encoding="utf-8")
        page = re.sub(
            rf"^\| `{name}` \| \d+ s \|(?: [^|]+ \|){{6}}", line, page, flags=re.MULTILINE
        )
        PAGE.write_text(page, encoding="utf-8")
        print(line, flush=True)


if __name__ == "__main__":
    main()
