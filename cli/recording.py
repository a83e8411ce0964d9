"""What commands do with a recording (`.take`): read it, turn instants into ticks, write it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .console import Console
from .outcome import Refused

if TYPE_CHECKING:
    from ergon._core import Recording

SUFFIX = ".take"
NAMES_MAX = 400  # characters shown of names in an untrusted file


def read(console: Console, path: Path, span: tuple[int, int] | None = None) -> Recording:
    """Read the intact part of a recording, with a warning if it is damaged. Raises Refused if it is
    not a recording.

    `span` keeps these ticks, counted from the first row.
    """
    recording = read_quietly(path, span)
    if recording.damage is not None:
        console.warn(f"{path}: {recording.damage}")
    return recording


def read_quietly(path: Path, span: tuple[int, int] | None = None) -> Recording:
    """Read without the warning, for callers that report the damage themselves."""
    from ergon._core import EngineError, read_recording

    try:
        return read_recording(path, span)
    except EngineError as error:
        raise Refused(f"{path}: {error}") from None
    except OSError as error:
        raise Refused(f"{path}: {error.strerror or error}") from None


def target(output_text: str, source_path: Path) -> Path:
    """The path to write a recording to, after checking its ending."""
    from ergon.exchange.safe import check_target

    path = Path(output_text)
    if path.suffix.lower() != SUFFIX:
        raise Refused(f"{output_text}: the name of a recording ends in {SUFFIX}")
    check_target(path, force=True, inputs=(source_path,))
    return path


def write(console: Console, recording: Recording, path: Path, *, force: bool, dry: bool) -> None:
    """Write a recording, or only say that it would be written."""
    from ergon.exchange.safe import check_target, open_for_writing

    # The movements of hands cannot be computed again.
    check_target(path, force=force, replaceable=False)
    if not dry:
        with open_for_writing(path, binary=True, force=force, replaceable=False) as file:
            file.write(recording.to_bytes())
    say(console, path, recording, dry=dry)


def say(console: Console, path: Path, recording: Recording, *, dry: bool) -> None:
    """Say what was written, or would be."""
    event_name = "would write" if dry else "wrote"
    n_ticks = len(recording.ticks())
    if console.json:
        console.record(
            event_name.replace(" ", "_"),
            file=str(path),
            ticks=n_ticks,
            duration_s=recording.duration,
            axes=recording.names,
        )
    else:
        names = ", ".join(recording.names)[:NAMES_MAX]
        console.say(f"{event_name} {path}: {names}, {recording.duration:.3f} s, {n_ticks:,} ticks")
