"""Frozen parts of a piece: the signals of their outputs, and a manifest that names the piece.

    DIR/frozen.json   {"made": …, "ergon_frozen": 1, "score": …, "seed": …, "stems": […]}
    DIR/01_gong.wav   a channel for each output of a part: doubles, before gains and high-passes

The files hold outputs, not mixed channels: one mixer processes the whole piece, so no bit of the
mix depends on which parts were frozen.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon.common.errors import ErgonError
from ergon.common.regular import read_bounded
from ergon.common.structured import parse_json

from .safe import MARK
from .wave import hash_samples, read_info
from .wave_header import NotWaveError, WaveFormat

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MANIFEST_VERSION = 1
MANIFEST_NAME = "frozen.json"
_MANIFEST_BYTES_MAX = 10_000_000  # bytes: no manifest is larger
_PARTS_MAX = 10_000


class NotFrozenError(ErgonError, ValueError):
    """The folder holds nothing that can be played with this piece; the message says why."""


@dataclass(frozen=True, slots=True)
class Source:
    """What the samples of frozen parts depend on; `plan` is the hash of how they were computed."""

    title: str
    score: str
    seed: int
    rate: float
    version: str
    plan: str = ""


@dataclass(frozen=True, slots=True)
class Stem:
    """The file of a part's outputs; `taps` are the indices of these outputs in the network, in
    order.
    """

    part: str
    path: Path
    taps: tuple[int, ...]
    sha256: str


@dataclass(frozen=True, slots=True)
class Frozen:
    """The content of a folder according to its manifest."""

    source: Source
    n_frames: int
    stems: tuple[Stem, ...]

    @property
    def parts(self) -> list[str]:
        """The parts that are frozen."""
        return list(dict.fromkeys(stem.part for stem in self.stems))


@dataclass(frozen=True, slots=True)
class VerifiedStem:
    """A stem whose file was checked; its samples are doubles from byte `offset` on."""

    path: Path
    offset: int
    n_frames: int
    taps: tuple[int, ...]

    def samples(self, first_frame: int = 0, n_frames: int | None = None) -> NDArray[np.float64]:
        """Its samples (n_frames, n_taps) from frame `first_frame` on; up to the last if `n_frames`
        is None.
        """
        import numpy as np

        tap_count = len(self.taps)
        n_frames = self.n_frames - first_frame if n_frames is None else n_frames
        with self.path.open("rb") as file:
            file.seek(self.offset + first_frame * tap_count * 8)
            samples = np.frombuffer(file.read(n_frames * tap_count * 8), "<f8")
        return samples.reshape(n_frames, tap_count)

    def copy_into(self, frames: NDArray[np.float64], start_frame: int) -> None:
        """Copy its samples from frame `start_frame` on into its columns of frames (n_frames,
        n_out).
        """
        frames[:, list(self.taps)] = self.samples(start_frame, len(frames))


def manifest_text(frozen: Frozen) -> str:
    """The manifest as the text of a file."""
    frozen_source = frozen.source
    header = {
        "made": f"{MARK.decode()} {frozen_source.version}",
        "ergon_frozen": MANIFEST_VERSION,
        "title": frozen_source.title,
        "score": frozen_source.score,
        "seed": frozen_source.seed,
        "rate": frozen_source.rate,
        "frames": frozen.n_frames,
        "plan": frozen_source.plan,
    }
    stems = [
        {"part": s.part, "file": s.path.name, "outputs": list(s.taps), "sha256": s.sha256}
        for s in frozen.stems
    ]
    return json.dumps(header | {"stems": stems}, indent=1, ensure_ascii=False) + "\n"


def read(folder: Path) -> Frozen:
    """Read the manifest of a folder. Raises NotFrozenError."""
    path = folder / MANIFEST_NAME
    try:
        manifest_data = read_bounded(path, _MANIFEST_BYTES_MAX)
        if len(manifest_data) > _MANIFEST_BYTES_MAX:
            raise NotFrozenError(f"{path}: the file is too large for a manifest")
        manifest = parse_json(manifest_data)
        if manifest["ergon_frozen"] != MANIFEST_VERSION:
            raise NotFrozenError(f"{path}: not a manifest of version {MANIFEST_VERSION}")
        frozen_source = Source(
            str(manifest["title"]),
            str(manifest["score"]),
            int(manifest["seed"]),
            _parse_rate(manifest["rate"]),
            str(manifest["made"]).removeprefix(f"{MARK.decode()} "),
            str(manifest["plan"]),
        )
        stems = tuple(_parse_stem(folder, stem) for stem in manifest["stems"][:_PARTS_MAX])
        return Frozen(frozen_source, int(manifest["frames"]), stems)
    except OSError as error:
        reason = error.strerror or "cannot be read"
        raise NotFrozenError(f"{path}: {reason}; ergon render --freeze writes it") from None
    except NotFrozenError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        raise NotFrozenError(f"{path}: not a manifest of frozen parts") from None


def _parse_rate(value: Any) -> float:
    rate = float(value)
    if not math.isfinite(rate):  # JSON in Python has Infinity and NaN, and 1e999
        raise ValueError
    return rate


def _parse_stem(folder: Path, stem_entry: Any) -> Stem:
    stem_name = str(stem_entry["file"])
    if Path(stem_name).name != stem_name or "\0" in stem_name:  # never outside of its folder
        raise NotFrozenError(
            f"{folder / MANIFEST_NAME}: {stem_name!r} is not the name of a file beside the manifest"
        )
    taps = tuple(int(tap) for tap in stem_entry["outputs"])
    return Stem(str(stem_entry["part"]), folder / stem_name, taps, str(stem_entry["sha256"]))


def check(frozen: Frozen, taps: Mapping[str, Sequence[int]], n_frames: int) -> list[VerifiedStem]:
    """The stems, if their files are unchanged and hold the outputs `taps` of each part.

    Every file is read once and hashed. Raises NotFrozenError.
    """
    taps_by_part: dict[str, list[int]] = {}
    for stem in frozen.stems:
        taps_by_part.setdefault(stem.part, []).extend(stem.taps)
    if frozen.n_frames < n_frames:
        raise NotFrozenError(f"it lasts {frozen.n_frames:,} frames, the piece {n_frames:,}")
    for part, part_taps in taps.items():
        if taps_by_part.get(part) != list(part_taps):
            raise NotFrozenError(f"'{part}' has other outputs in the score")
    return [_verified_stem(stem, frozen) for stem in frozen.stems]


def _verified_stem(stem: Stem, frozen: Frozen) -> VerifiedStem:
    try:
        info = read_info(stem.path)
        expected_format = WaveFormat(int(frozen.source.rate), len(stem.taps), "double")
        if info.format != expected_format or info.n_frames != frozen.n_frames:
            raise NotFrozenError(f"{stem.path} is not the file that was frozen")
        if hash_samples(stem.path) != stem.sha256:
            raise NotFrozenError(f"{stem.path} is not the file that was frozen: its samples differ")
    except (OSError, NotWaveError) as error:
        raise NotFrozenError(f"{stem.path}: {error}") from None
    return VerifiedStem(stem.path, info.samples_offset, info.n_frames, stem.taps)
