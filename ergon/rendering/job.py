"""What is asked of a render, and what it wrote."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.exchange import sound
from ergon.exchange.wave_header import Stamp, WaveFormat

from .balance import InstrumentLevel
from .edges import NO_EDGES_FADED, Edges
from .filmed import MotionRecording
from .level import Level
from .mixed_stretches import Outcome, SilenceSearch
from .remote import Workers
from .silence import FadedSilence

if TYPE_CHECKING:
    from ergon.exchange.stretch_store import StretchStore

BLOCK_FRAMES = 4096  # frames: long enough that Python costs nothing, short enough for the cache


@dataclass(frozen=True, slots=True)
class RenderJob:
    """What is rendered: frames `start` to `stop` of the piece, in channels and bits of `format`."""

    target: str
    format: WaveFormat
    start: int
    stop: int
    level: Level
    stamp: Stamp
    stems: Path | None = None
    splits_stems: bool = False  # a dry stem for each instrument, and the answer of the rooms
    block_frames: int = BLOCK_FRAMES
    threads: int = 1
    force: bool = False
    inputs: Sequence[Path] = ()  # files that are read, and so never overwritten
    silences: Sequence[FadedSilence] = ()  # silences of panics, in frames of the piece
    edges: Edges = NO_EDGES_FADED
    # Frame from which the piece may end, once its sound has faded.
    fades_from: int | None = None
    is_part: bool = False  # the file ends at `stop`, whether the sound has faded or not
    stretches: StretchStore | None = None  # stretches of earlier renders
    motion: MotionRecording | None = None  # the motion file to write as well
    workers: Workers | None = None  # other processes that compute islands
    stores_mix: bool = True  # store the mix too, not the islands alone
    measures_instruments: bool = True  # how loud each is by itself, if there are several

    def __post_init__(self) -> None:
        """Raise FileRefusedError when the target cannot hold the samples."""
        sound.check_format(self.target, self.format)

    @property
    def n_frames(self) -> int:
        """Frames in the file."""
        return self.stop - self.start

    @property
    def has_open_end(self) -> bool:
        """Whether the length of the file is known only when the sound has faded."""
        return self.fades_from is not None and not self.is_part

    @property
    def silence_search(self) -> SilenceSearch | None:
        """The search for silence, where the end of the piece is needed: for the length of the file,
        or for a level.
        """
        if self.fades_from is None or not (self.has_open_end or self.level.is_levelled):
            return None
        return self.fades_from, self.format.n_channels

    def simulated_frames(self, n_frames: int) -> int:
        """Frames to compute of a piece of `n_frames`: a level is that of the whole piece."""
        return n_frames if self.level.is_levelled else min(self.stop, n_frames)


@dataclass(frozen=True, slots=True)
class RenderedFile:
    """One file: peak, gain and true peak as ratios, loudness [LUFS], hash of the samples."""

    path: str
    peak: float
    loudness: float
    gain: float
    sha256: str
    true_peak: float


@dataclass(frozen=True, slots=True)
class RenderedFiles:
    """The files that a render wrote, their length, and how long it took: `wall_seconds`.

    `n_simulated` frames were computed or recalled. `instruments` are the levels of the instruments,
    if there are several. `recalled_share` is the share of the work that an earlier render had done
    (0 to 1); if that is all, `outcome` is what its simulation reported.
    """

    mix: RenderedFile
    stems: tuple[RenderedFile, ...]
    wall_seconds: float
    n_frames: int
    n_simulated: int
    instruments: tuple[InstrumentLevel, ...] = ()
    recalled_share: float = 0.0
    outcome: Outcome | None = None
