"""`ergon share`: a piece as one HTML file that plays without a server and a network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report
from ergon.common.structured import parse_json
from ergon.exchange.safe import check_target, write_text

from .errors import OptionError
from .film import FPS
from .pages import ANY_LOCAL_PORT, serve
from .shared_page import page_files, shared_page
from .viewing import EARS, flac_file

if TYPE_CHECKING:
    from ergon.scores.staging.stage import Stage

    from .render import PreparedRender
    from .viewing import Shown

LIMIT_MB = 50.0
_BYTES_PER_MEGABYTE = 1e6
_BASE64_RATIO = 4 / 3  # characters of base64 for a byte

# Typical sizes of what ships [bytes]; a piece may have half of them, or twice as much.
_SAMPLED_POINT_BYTES_PER_SECOND = 60.0  # a second, of a mass whose positions are sampled
_FREE_POINT_BYTES_PER_SECOND = 15.0  # a second, of a free oscillation or a mode
_CHUNK_BYTES = 2  # head of a chunk of the motion file, deflated
_KEY_BYTES, _SPEAKER_BYTES = 6, 4  # bytes for each in every frame of the motion
_FLAC_RATIO = 0.25  # estimated size over that of the samples
_ESTIMATE_RATIO_MAX = (
    2.0  # a piece is refused before it is computed if its estimate is so many limits
)


@dataclass(frozen=True, slots=True)
class SharedFile:
    """The file that was written, with its size and that of its parts [bytes]."""

    path: str
    size: int
    motion: int
    sound: int


def check_estimate(prepared: PreparedRender, path: Path, limit_mb: float) -> None:
    """Refuse a piece that is far too long, before it is computed. Raises OptionError.

    The size is estimated from its length, its channels and the points that move.
    """
    film, rate = prepared.job.motion, prepared.stage.rate
    if film is None:
        return
    duration = film.last_sample_frame / rate
    motion_bytes = duration * _motion_bytes_per_second(prepared.stage)
    sound_bytes = duration * rate * min(film.n_channels, EARS) * 2 * _FLAC_RATIO
    n_bytes = _BASE64_RATIO * (motion_bytes + sound_bytes)
    if n_bytes > _ESTIMATE_RATIO_MAX * limit_mb * _BYTES_PER_MEGABYTE:
        fitting_seconds = duration * limit_mb * _BYTES_PER_MEGABYTE / n_bytes
        raise OptionError(
            "limit",
            f"{path} would have about {_megabytes_text(n_bytes)} "
            f"({_megabytes_text(_BASE64_RATIO * motion_bytes)} of "
            f"motion, {_megabytes_text(_BASE64_RATIO * sound_bytes)} of sound), more than "
            f"{limit_mb:g} MB, so it was "
            f"not computed; share a shorter stretch than its {duration:,.0f} s (about "
            f"{fitting_seconds:,.0f} s fit), or allow more",
        )


def _motion_bytes_per_second(stage: Stage) -> float:
    """About how many bytes a second of a motion file has."""
    from ergon import _core

    bytes_by_kind = {
        "sampled": _SAMPLED_POINT_BYTES_PER_SECOND,
        "free": _FREE_POINT_BYTES_PER_SECOND,
        "modal": _FREE_POINT_BYTES_PER_SECOND,
    }
    runs = _core.MotionLook(stage.simulation).runs()
    point_bytes = sum(run.count * bytes_by_kind.get(run.kind, 0.0) for run in runs)
    key_bytes = _CHUNK_BYTES + _KEY_BYTES * len(stage.piece.keys) if stage.piece.keys else 0
    return point_bytes + FPS * (key_bytes + _CHUNK_BYTES + _SPEAKER_BYTES * stage.n_channels)


def share_file(
    view: Shown,
    path: Path,
    folder: Path,
    report: Report,
    *,
    limit_mb: float = LIMIT_MB,
    force: bool = False,
    inputs: tuple[Path, ...] = (),
    words: tuple[str, ...] = (),
) -> SharedFile:
    """Write a motion file and its sound as one HTML file.

    `folder` takes what lies between. `words` are of the page's address: stage, strobe. Raises
    OptionError where the file would be larger than `limit_mb`, FileRefusedError, OSError.
    """
    check_target(path, force=force, inputs=inputs)
    sound_bytes = None if view.sound is None else flac_file(view.sound, folder).read_bytes()
    motion = view.motion.read_bytes()
    page_bytes = _BASE64_RATIO * (len(motion) + len(sound_bytes or b""))
    if page_bytes > limit_mb * _BYTES_PER_MEGABYTE:
        parts_text = f"{_megabytes_text(_BASE64_RATIO * len(motion))} of motion"
        if sound_bytes is not None:
            parts_text += f", {_megabytes_text(_BASE64_RATIO * len(sound_bytes))} of sound"
        raise OptionError(
            "limit",
            f"{path} would have {_megabytes_text(page_bytes)} ({parts_text}), more than "
            f"{limit_mb:g} MB; share a shorter stretch, or allow more",
        )
    server = serve(ANY_LOCAL_PORT, "at", report)
    try:
        page_words = [*words, *(["sound"] if sound_bytes is not None else [])]
        page_text = shared_page(
            page_files(server.url), _shown_title(view), page_words, motion, sound_bytes
        )
    finally:
        server.close()
    write_text(path, page_text, force=force, inputs=inputs)
    return SharedFile(str(path), len(page_text.encode()), len(motion), len(sound_bytes or b""))


def _shown_title(view: Shown) -> str:
    from ergon import _core

    title = parse_json(_core.read_motion(view.motion).manifest).get("title")
    return str(title or "ergon")


def _megabytes_text(size: float) -> str:
    return f"{size / _BYTES_PER_MEGABYTE:.1f} MB"
