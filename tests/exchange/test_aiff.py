"""AIFF files: the samples that libsndfile reads, their marks, and what is refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import soundfile
from commands import forked

from ergon.exchange import sound
from ergon.exchange.wave_header import NotWaveError

SHAPE = 1_000, 3
INTEGERS = np.random.default_rng(2).integers(-(2**31), 2**31, SHAPE, dtype=np.int64)
# Codings and orders of bytes that libsndfile writes.
CODINGS = [
    *((subtype, "FILE") for subtype in ("PCM_S8", "PCM_U8", "PCM_16", "PCM_24", "PCM_32")),
    *((subtype, "FILE") for subtype in ("FLOAT", "DOUBLE")),
    ("PCM_16", "LITTLE"),
    ("PCM_16", "BIG"),
    ("PCM_24", "BIG"),
    ("PCM_32", "BIG"),
]


def make(path: Path, subtype: str, endian: str = "FILE") -> None:
    frames = INTEGERS.astype(np.int32) if subtype.startswith("PCM") else INTEGERS / 2.0**31
    soundfile.write(path, frames, 48_000, format="AIFF", subtype=subtype, endian=endian)


def read(path: Path) -> np.ndarray:
    return np.concatenate([*sound.read_blocks(path)])


def chunk(name: bytes, content: bytes) -> bytes:
    return name + struct.pack(">I", len(content)) + content + bytes(len(content) % 2)


def form(*chunks: bytes, kind: bytes = b"AIFF") -> bytes:
    body = kind + b"".join(chunks)
    return b"FORM" + struct.pack(">I", len(body)) + body


RATE_8000 = bytes.fromhex("400bfa00000000000000")  # 8000 as an extended number
COMM = chunk(b"COMM", struct.pack(">HIH", 1, 4, 16) + RATE_8000)
SSND = chunk(b"SSND", struct.pack(">II4h", 0, 0, 1, -2, 300, -32768))


@pytest.mark.parametrize(("subtype", "endian"), CODINGS)
def test_aiff_samples_equal_libsndfile(tmp_path: Path, subtype, endian):
    path = tmp_path / "a.aiff"
    make(path, subtype, endian)
    expected, rate = soundfile.read(path, always_2d=True)
    info = sound.read_info(path)
    assert (info.format.rate, info.format.n_channels, info.n_frames) == (rate, 3, 1_000)
    assert info.container in ("AIFF", "AIFC")
    assert np.array_equal(read(path), expected)


@pytest.mark.parametrize("subtype", ["PCM_S8", "PCM_16", "PCM_24", "PCM_32", "FLOAT"])
def test_aiff_hash_equals_wav_hash(tmp_path: Path, subtype):
    make(tmp_path / "a.aif", subtype)
    frames, rate = soundfile.read(
        tmp_path / "a.aif", dtype="int32" if "PCM" in subtype else "float32"
    )
    soundfile.write(tmp_path / "a.wav", frames, rate, subtype=subtype.replace("S8", "U8"))
    assert sound.digest_samples(tmp_path / "a.aif") == sound.digest_samples(tmp_path / "a.wav")


def test_aiff_32_bit_integers_are_exact(tmp_path: Path):
    make(tmp_path / "a.aiff", "PCM_32")
    assert np.array_equal(read(tmp_path / "a.aiff") * 2.0**31, INTEGERS)


def test_aiff_chunks_in_any_order(tmp_path: Path):
    """Samples first, text of odd sizes, marks; an offset before the first sample."""
    late = chunk(
        b"SSND", struct.pack(">II", 2, 0) + b"\xff\xff" + struct.pack(">4h", 1, -2, 300, -32768)
    )
    named = struct.pack(">HHIB", 2, 1, 0, 5) + b"start" + struct.pack(">HIB", 2, 3, 4) + b"last\0"
    data = form(
        late, chunk(b"NAME", b"Two"), COMM, chunk(b"MARK", named), chunk(b"INST", bytes(20))
    )
    (tmp_path / "a.aif").write_bytes(data)
    info = sound.read_info(tmp_path / "a.aif")
    assert (info.title, info.format.rate, info.n_frames) == ("Two", 8_000, 4)
    assert info.marks == (("start", 0), ("last", 3))
    assert info.unread_chunks == (("INST", 20),)
    expected = np.array([1, -2, 300, -32768]) / 32768
    assert np.array_equal(read(tmp_path / "a.aif")[:, 0], expected)


@pytest.mark.parametrize(
    ("n_frames", "sound_size"),
    [(0, 0), (0, 16), (0x7F000000 // 2, 0x7F000008), (0xFFFFFFFF, 0xFFFFFFFF), (0, 0xFFFFFFFF)],
)
def test_aiff_of_a_pipe_has_all_frames_of_its_sound(tmp_path: Path, n_frames: int, sound_size: int):
    """As ffmpeg and SoX leave frames and size where they cannot go back to write them."""
    comm = chunk(b"COMM", struct.pack(">HIH", 1, n_frames, 16) + RATE_8000)
    sound_chunk = b"SSND" + struct.pack(">I", sound_size) + SSND[8:]
    later_chunks = chunk(b"ANNO", b"ffm"), chunk(b"NAME", b"Two")
    (tmp_path / "a.aiff").write_bytes(form(comm, sound_chunk, *later_chunks))
    info = sound.read_info(tmp_path / "a.aiff")
    assert (info.n_frames, info.missing_bytes, info.damage) == (4, 0, None)
    assert (info.title, info.unread_chunks) == ("Two", (("ANNO", 3),))
    assert np.array_equal(read(tmp_path / "a.aiff")[:, 0] * 32768, [1, -2, 300, -32768])


def test_empty_aiff_holds_no_frames(tmp_path: Path):
    comm = chunk(b"COMM", struct.pack(">HIH", 1, 0, 16) + RATE_8000)
    (tmp_path / "a.aiff").write_bytes(form(comm, chunk(b"SSND", bytes(8))))
    assert sound.read_info(tmp_path / "a.aiff").n_frames == 0


def test_info_command_of_aiff_file(tmp_path: Path):
    marks = chunk(b"MARK", struct.pack(">HHIB", 1, 1, 2, 6) + b"\x1b[31ma" + b"\0")
    (tmp_path / "a.aiff").write_bytes(form(COMM, marks, SSND, chunk(b"APPL", b"abcd")))
    done = forked(("info", "a.aiff"), tmp_path)
    assert done.returncode == 0, done.stderr
    for words in ("4 frames", "1 channel", "8000 Hz", "16 bits", "AIFF", "chunk APPL, 4 bytes"):
        assert words in done.stdout, done.stdout
    assert "mark:    ?[31ma, 0.000 s (frame 2)" in done.stdout


@pytest.mark.parametrize("name", ["a.aiff", "a.wav", "a"])
def test_commands_read_aiff_under_any_name(tmp_path: Path, name: str):
    """And says the same as of the WAV file of the same samples."""
    t = np.arange(24_000) / 48_000.0
    stroke = 0.5 * np.exp(-8.0 * t) * np.sin(2 * np.pi * 440.0 * t)
    printed = {}
    for folder, kind in (("one", "AIFF"), ("two", "WAV")):
        (tmp_path / folder).mkdir()
        path = tmp_path / folder / name
        with path.open("wb") as file:
            soundfile.write(file, np.stack([stroke, stroke], 1), 48_000, "PCM_32", format=kind)
        for words in (
            ("bell",),
            ("fold", "--to", "stereo", "--layout", "stereo", "-o", "o.wav"),
            ("plot",),
        ):
            command, *more = words
            done = forked((command, name, *more), tmp_path / folder)
            assert done.returncode == 0, (words, done.stderr)
            printed.setdefault(command, []).append(done.stdout)
    assert all(first == second for first, second in printed.values())
    first, second = ((tmp_path / folder / "o.wav").read_bytes() for folder in ("one", "two"))
    assert first == second


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (form(SSND), "holds no samples"),
        (form(COMM), "holds no samples"),
        (form(chunk(b"COMM", b"12345")), "ends within its header"),
        (form(COMM[:26].replace(RATE_8000, bytes(10)), SSND), "at 0 Hz"),
        (form(COMM.replace(RATE_8000, b"\x7f\xff" * 5), SSND), "at 0 Hz"),
        (form(chunk(b"COMM", COMM[8:26] + b"ima4\0\0"), SSND, kind=b"AIFC"), "coded as ima4"),
    ],
)
def test_malformed_aiff_files_are_refused(tmp_path: Path, data: bytes, message: str):
    (tmp_path / "a.aiff").write_bytes(data)
    with pytest.raises(NotWaveError, match=message):
        sound.read_info(tmp_path / "a.aiff")


def test_read_of_a_cut_aiff_file(tmp_path: Path):
    (tmp_path / "a.aiff").write_bytes(form(COMM, SSND)[:-2])
    info = sound.read_info(tmp_path / "a.aiff")
    assert info.damage is not None
    assert "of 4 frames 3 are there" in info.damage
    assert len(read(tmp_path / "a.aiff")) == 3


def test_damaged_aiff_is_refused_or_read(tmp_path: Path):
    make(tmp_path / "a.aiff", "PCM_24")
    complete = (tmp_path / "a.aiff").read_bytes()[:600]
    changed = [complete[:n] for n in range(0, len(complete), 7)]
    for index in range(120):
        changed.append(complete[:index] + bytes([complete[index] ^ 0x55]) + complete[index + 1 :])
    n_read = 0
    for data in changed:
        (tmp_path / "a.aiff").write_bytes(data)
        try:
            info = sound.read_info(tmp_path / "a.aiff")
            assert len(read(tmp_path / "a.aiff")) == info.n_frames
            n_read += 1
        except (NotWaveError, ValueError):
            continue
    assert 0 < n_read < len(changed)
