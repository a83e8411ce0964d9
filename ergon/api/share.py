"""`ergon share`: a piece as one HTML file that plays without a server and a network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report
from ergon.common.structured import parse_json
from ergon.exchange.safe import check_target, write_text

from .errors import OptionError
from .pages import ANYWHERE, serve
from .shared_page import page_files, shared_page
from .viewing import as_flac

if TYPE_CHECKING:
    from .viewing import Shown

LIMIT_MB = 50.0
_MEGA = 1e6
_CODED = 4 / 3  # characters of base64 for a byte


@dataclass(frozen=True, slots=True)
class SharedFile:
    """The file that was written, with its size and that of its parts [bytes]."""

    path: str
    size: int
    motion: int
    sound: int


def share_file(
    shown: Shown,
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
    sound = None if shown.sound is None else as_flac(shown.sound, folder).read_bytes()
    motion = shown.motion.read_bytes()
    size = _CODED * (len(motion) + len(sound or b""))
    if size > limit_mb * _MEGA:
        parts = f"{_megabytes(_CODED * len(motion))} of motion"
        if sound is not None:
            parts += f", {_megabytes(_CODED * len(sound))} of sound"
        raise OptionError(
            "limit",
            f"{path} would have {_megabytes(size)} ({parts}), more than {limit_mb:g} MB; share "
            "a shorter stretch, or allow more",
        )
    server = serve(ANYWHERE, "at", report)
    try:
        asked = [*words, *(["sound"] if sound is not None else [])]
        text = shared_page(page_files(server.url), _title(shown), asked, motion, sound)
    finally:
        server.close()
    write_text(path, text, force=force, inputs=inputs)
    return SharedFile(str(path), len(text.encode()), len(motion), len(sound or b""))


def _title(shown: Shown) -> str:
    from ergon import _core

    title = parse_json(_core.read_motion(shown.motion).manifest).get("title")
    return str(title or "ergon")


def _megabytes(size: float) -> str:
    return f"{size / _MEGA:.1f} MB"
