"""Renders in FLAC: the samples of the WAV file, known again, and refused where FLAC cannot hold."""

from __future__ import annotations

import errno
import io
from pathlib import Path

import numpy as np
import pytest
import soundfile

from ergon.common import sound_files
from ergon.exchange import sound
from ergon.exchange.flac import FlacWriter
from ergon.exchange.safe import FileRefusedError
from ergon.exchange.wave_header import ORIGINATOR, NotWaveError, Stamp, WaveFormat

RNG = np.random.default_rng(5)
STAMP = Stamp("Three bells", "a" * 64, "b" * 64)


def _samples(n_frames: int, format: WaveFormat) -> np.ndarray:
    low = 32 - int(format.bits)
    complete = RNG.integers(-(2**31), 2**31, (n_frames, format.n_channels), dtype=np.int64)
    return (complete >> low << low).astype(np.int32)


def _write(path: Path, format: WaveFormat, samples: np.ndarray) -> str:
    with path.open("w+b") as file:
        writer = sound.writer(str(path), file, format, len(samples), STAMP)
        for index in range(0, len(samples), 1000):
            writer.write(samples[index : index + 1000])
        writer.close()
        return writer.sha256


@pytest.mark.parametrize(("bits", "n_channels"), [(16, 1), (24, 2), (24, 8)])
def test_flac_samples_and_info_equal_wav(tmp_path: Path, bits, n_channels):
    format = WaveFormat(44_100, n_channels, bits)
    samples = _samples(2_345, format)
    hashes = {_write(tmp_path / f"x{end}", format, samples) for end in sound_files.SUFFIXES}
    assert len(hashes) == 1
    read, rate = soundfile.read(tmp_path / "x.flac", dtype="int32", always_2d=True)
    assert rate == 44_100
    assert np.array_equal(read, samples)
    flac, wav = (sound.read_info(tmp_path / f"x{end}") for end in (".flac", ".wav"))
    assert (flac.format, flac.n_frames, flac.title) == (wav.format, wav.n_frames, wav.title)
    assert (flac.score, flac.plan) == ("a" * 64, "b" * 64)
    assert {sound.digest_samples(tmp_path / f"x{end}")[0] for end in sound_files.SUFFIXES} == hashes
    blocks = [
        np.concatenate(list(sound.read_blocks(tmp_path / f"x{e}"))) for e in sound_files.SUFFIXES
    ]
    assert np.array_equal(*blocks)


def test_flac_without_title(tmp_path: Path):
    format = WaveFormat(48_000, 1, 24)
    samples = _samples(10, format)
    for end in sound_files.SUFFIXES:
        with (tmp_path / f"x{end}").open("w+b") as file:
            writer = sound.writer(f"x{end}", file, format, 10, Stamp("", "a" * 64, "b" * 64))
            writer.write(samples)
            writer.close()
    flac, wav = (sound.read_info(tmp_path / f"x{end}") for end in (".flac", ".wav"))
    assert (flac.title, flac.score) == (wav.title, wav.score)
    assert flac.originator == ORIGINATOR


def test_flac_originator_of_ours_and_others(tmp_path: Path):
    format = WaveFormat(48_000, 2, 24)
    _write(tmp_path / "ours.flac", format, _samples(10, format))
    soundfile.write(tmp_path / "theirs.flac", np.zeros((10, 2)), 48_000)
    assert sound.read_info(tmp_path / "ours.flac").originator == ORIGINATOR
    assert sound.read_info(tmp_path / "theirs.flac").originator is None
    assert sound.read_info(tmp_path / "theirs.flac").score is None


@pytest.mark.parametrize(
    ("target", "format", "reason"),
    [
        ("x.flac", WaveFormat(44_100, 2, "float"), "16 or 24 bits, not float"),
        ("x.flac", WaveFormat(44_100, 9, 24), "8 channels, not 9"),
        ("x.flac", WaveFormat(700_000, 2, 24), "at most 655,350"),
        ("x.mp3", WaveFormat(44_100, 2, 24), "ends in .mp3, .* write x.wav"),
        ("x", WaveFormat(44_100, 2, 24), "has no ending, .* write x.wav"),
    ],
)
def test_flac_unsupported_formats_are_refused(target, format, reason):
    with pytest.raises(FileRefusedError, match=reason):
        sound.check_format(target, format)


@pytest.mark.parametrize("target", ["-", "/dev/null", "X.WAV", "x.FLAC"])
def test_sound_file_names_with_supported_format(target):
    sound.check_format(target, WaveFormat(44_100, 2, 24))


class _Full(io.BytesIO):
    def write(self, data, /):
        if self.tell() + len(bytes(data)) > 4_000:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)


def test_flac_write_on_full_disk():
    format = WaveFormat(44_100, 2, 24)
    writer = FlacWriter(_Full(), format, 50_000, STAMP)
    with pytest.raises(OSError, match="No space left"):
        writer.write(_samples(50_000, format))


def test_flac_wrong_frame_count_is_refused():
    format = WaveFormat(44_100, 2, 24)
    writer = FlacWriter(io.BytesIO(), format, 10, STAMP)
    with pytest.raises(ValueError, match="1 frames more"):
        writer.write(_samples(11, format))
    with pytest.raises(ValueError, match="10 frames fewer"):
        writer.close()


def test_read_info_of_non_flac_file(tmp_path: Path):
    (tmp_path / "x.flac").write_bytes(b"RIFF" + bytes(100))
    with pytest.raises(NotWaveError, match="not FLAC"):
        sound.read_info(tmp_path / "x.flac")


def test_damaged_flac_is_refused_or_read(tmp_path: Path):
    """No cut and no flipped byte of a small file ends in another error."""
    format = WaveFormat(44_100, 1, 16)
    path = tmp_path / "x.flac"
    _write(path, format, _samples(300, format))
    complete = path.read_bytes()
    changed = [complete[:n] for n in range(0, len(complete), 7)]
    for index in range(0, len(complete), 7):
        changed.append(complete[:index] + bytes([complete[index] ^ 0x55]) + complete[index + 1 :])
    for data in changed:
        path.write_bytes(data)
        try:
            sound.read_info(path)
            sound.digest_samples(path)
        except NotWaveError:
            continue
