"""WAV files of movements as other programs write them: what `info` reads of them, a take has."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from ergon.exchange import sound
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.gesture.takes import read

N_FRAMES = 40
PLACES = np.round(np.sin(np.arange(2.0 * N_FRAMES)).reshape(N_FRAMES, 2) * 2**14) / 2**15
GUID_TAIL = bytes.fromhex("000000001000800000aa00389b71")


def chunk(name: bytes, content: bytes, size: int | None = None, filling: bytes = b"\0") -> bytes:
    stated = len(content) if size is None else size
    return name + struct.pack("<I", stated) + content + filling * (len(content) & 1)


def packed(width: int) -> bytes:
    """Whole numbers of `width` bytes."""
    numbers = (PLACES * 2.0 ** (8 * width - 1)).astype("<i8").reshape(-1, 1)
    return numbers.view("u1")[:, :width].tobytes()


def fmt(bits: int, width: int, valid: int | None = None) -> bytes:
    """A format of two channels of `bits` in words of `width` bytes; extensible with `valid`."""
    tag = 1 if valid is None else 0xFFFE
    content = struct.pack("<HHIIHH", tag, 2, 1000, 2000 * width, 2 * width, bits)
    if valid is not None:
        content += struct.pack("<HHIH", 22, valid, 3, 1) + GUID_TAIL
    return chunk(b"fmt ", content)


def riff(body: bytes, size: int | None = None) -> bytes:
    return b"RIFF" + struct.pack("<I", 4 + len(body) if size is None else size) + b"WAVE" + body


def rf64(name: bytes, sizes: tuple[int, int]) -> bytes:
    """RF64 or BW64 whose chunk of long sizes says those of the file and of the samples."""
    ds64 = chunk(b"ds64", struct.pack("<QQQI", *sizes, N_FRAMES, 0))
    body = ds64 + fmt(16, 2) + b"data" + struct.pack("<I", 0xFFFFFFFF) + packed(2)
    return name + struct.pack("<I", 0xFFFFFFFF) + b"WAVE" + body


DATA = chunk(b"data", packed(2))
READ = {
    "24 in 32 by valid bits": riff(fmt(32, 4, 24) + chunk(b"data", packed(4))),
    "20 in 24 by valid bits": riff(fmt(24, 3, 20) + chunk(b"data", packed(3))),
    "no filling byte": riff(fmt(16, 2) + chunk(b"LIST", b"INFOx", filling=b"") + DATA),
    "unknown without filling byte": riff(fmt(16, 2) + chunk(b"xyz ", b"abc", filling=b"") + DATA),
    "pipe of SoX": riff(fmt(16, 2) + chunk(b"data", packed(2), 0x7FFFF000), 0x7FFFF024),
    "pipe of ffmpeg": riff(fmt(16, 2) + chunk(b"data", packed(2), 0xFFFFFFFF), 0xFFFFFFFF),
    "RF64 of sizes 0": rf64(b"RF64", (0, 0)),
    "BW64 of sizes -1": rf64(b"BW64", (2**64 - 1, 2**64 - 1)),
}  # fmt: skip


@pytest.mark.parametrize("case", READ)
def test_wav_take_of_programs_and_pipes(case: str, tmp_path: Path) -> None:
    path = tmp_path / "hand.wav"
    path.write_bytes(READ[case])
    assert sound.read_info(path).n_frames == N_FRAMES
    for channel in (0, 1):
        take = read(path, str(channel + 1))
        assert take.x == pytest.approx(PLACES[:, channel], abs=1e-6)
        assert take.t == pytest.approx(np.arange(N_FRAMES) / 1000)


@pytest.mark.parametrize(
    ("bits", "width", "valid"), [(24, 4, None), (20, 4, None), (16, 4, None), (16, 3, 16)]
)
def test_wav_take_of_samples_in_longer_words(
    bits: int, width: int, valid: int | None, tmp_path: Path
) -> None:
    """Read by the bytes that the samples need, they were noise near full scale."""
    path = tmp_path / "hand.wav"
    path.write_bytes(riff(fmt(bits, width, valid) + chunk(b"data", packed(width))))
    with pytest.raises(
        TakeError, match=rf"a frame of 2 × {bits} bits has {2 * width} bytes .*save"
    ):
        read(path, "1")


@pytest.mark.parametrize("name", [b"RF64", b"BW64", b"RIFF"])
def test_wav_take_cut_short(name: bytes, tmp_path: Path) -> None:
    samples = packed(2)
    if name == b"RIFF":
        data = riff(fmt(16, 2) + DATA)
    else:
        data = rf64(name, (4 + 36 + 24 + 8 + len(samples), len(samples)))
    path = tmp_path / "hand.wav"
    path.write_bytes(data)
    assert len(read(path, "1").x) == N_FRAMES
    path.write_bytes(data[: -len(samples) // 2])
    with pytest.raises(TakeError, match="shorter than its header says: of 40 frames 20 are there"):
        read(path, "1")
