"""What a page shows and plays: the motion of a piece, and its sound on two channels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report
from ergon.common.structured import parse_json
from ergon.exchange.wave_header import NotWaveError, Stamp, WaveFormat

from . import score as scores
from .film import SUFFIX
from .fold import FoldError, FoldOptions, fold_file
from .options import FileOptions
from .render import PreparedRender, prepare, write

if TYPE_CHECKING:
    from ergon.exchange.wave_header import WaveInfo

_SOUND_SUFFIXES = (".wav", ".flac")
EARS = 2


@dataclass(frozen=True, slots=True)
class Shown:
    """A motion file and, if there is one, a WAV file of one or two channels of the same piece."""

    motion: Path
    sound: Path | None


def render_view(
    score: Path,
    folder: Path,
    options: FileOptions,
    report: Report,
    check: Callable[[PreparedRender], None] | None = None,
) -> Shown:
    """Compute sound and motion of a score into a folder, unless `check` raises before that.

    Raises as `render_to_file` does.
    """
    sound_path = folder / "piece.wav"
    loaded = scores.read(score, options, report)
    prepared = prepare(loaded, str(sound_path), options, report)
    if check is not None:
        check(prepared)
    write(prepared, report)
    return Shown(sound_path.with_suffix(SUFFIX), binaural_file(sound_path, folder, report))


def sound_beside(motion: Path, report: Report) -> Path | None:
    """The sound file beside a motion file, of the same name and the same score; else None.

    A message says if a file of that name is of another score. Raises OSError and EngineError if
    the motion cannot be read.
    """
    from ergon import _core
    from ergon.exchange import sound

    sound_path = next(
        (path for suffix in _SOUND_SUFFIXES if (path := motion.with_suffix(suffix)).is_file()), None
    )
    if sound_path is None:
        return None
    motion_digest = parse_json(_core.read_motion(motion).manifest).get("score_sha256")
    try:
        score_digest = sound.read_info(sound_path).score
    except (NotWaveError, OSError):
        score_digest = None
    if score_digest is None or score_digest != motion_digest:
        report.say(f"{sound_path} is not the sound of {motion}, so it is not played")
        return None
    return sound_path


def binaural_file(path: Path, folder: Path, report: Report) -> Path:
    """A sound file as browsers play it: itself, or a WAV file in `folder`.

    More than two channels are folded to two ears if the file says where its loudspeakers are;
    else its odd channels go to the left and its even ones to the right. Raises NotWaveError and
    OSError.
    """
    from ergon.exchange import sound

    wave_info = sound.read_info(path)
    if (
        wave_info.format.n_channels <= EARS
        and wave_info.container == "RIFF"
        and wave_info.format.bits in (16, 24, "float")
    ):
        return path
    folded_path = folder / "two-ears.wav"
    if wave_info.format.n_channels > EARS:
        try:
            options = FoldOptions(bits=16, force=True)
            fold_file(path, folded_path, "binaural", options, report=report)
        except FoldError:
            report.say(
                f"{path} does not say where its loudspeakers are: its odd channels are heard on "
                "the left, its even ones on the right"
            )
        else:
            return folded_path
    _odd_and_even_means(path, wave_info, folded_path)
    return folded_path


def flac_file(path: Path, folder: Path) -> Path:
    """A sound file of one or two channels as FLAC of 16 bits, which every browser of today plays.

    Raises NotWaveError and OSError.
    """
    from ergon.exchange import sound

    flac_path = folder / "sound.flac"
    _odd_and_even_means(path, sound.read_info(path), flac_path)
    return flac_path


def _odd_and_even_means(path: Path, wave_info: WaveInfo, target_path: Path) -> None:
    """The means of odd and of even channels; one channel alone stays one."""
    import numpy as np

    from ergon import _core
    from ergon.exchange import sound
    from ergon.exchange.safe import open_for_writing

    n_channels = min(wave_info.format.n_channels, EARS)
    wave_format = WaveFormat(wave_info.format.rate, n_channels, 16)
    with open_for_writing(str(target_path), binary=True, force=True, inputs=(path,)) as file:
        writer = sound.writer(
            str(target_path), file, wave_format, wave_info.n_frames, Stamp(path.stem)
        )
        for block in sound.read_blocks(path):
            channel_means = [
                block[:, channel_index::n_channels].mean(axis=1)
                for channel_index in range(n_channels)
            ]
            writer.write(_core.pcm(np.ascontiguousarray(np.stack(channel_means, axis=1)), 1.0, 16))
        writer.close()
