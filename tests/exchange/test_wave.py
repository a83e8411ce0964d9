"""WAVE files: read back by libsndfile, and byte for byte against the published layout."""

import hashlib
import io
import struct
from pathlib import Path

import numpy as np
import pytest
import soundfile

from ergon.exchange.wave import WaveWriter, hash_samples, is_render, read_blocks, read_info
from ergon.exchange.wave_header import NotWaveError, Stamp, WaveFormat, pack, parse
from ergon.scores.gesture.takes import read as read_take

HASH = hashlib.sha256(b"a score").hexdigest()
STAMP = Stamp("Étude for one bell", HASH)
SUBTYPES = {16: "PCM_16", 24: "PCM_24", "float": "FLOAT"}


def samples(format: WaveFormat, n_frames: int) -> np.ndarray:
    draw = np.random.default_rng(7).uniform(-1, 1, (n_frames, format.n_channels))
    if format.bits == "float":
        return draw.astype(np.float32)
    complete = np.rint(draw * (2 ** (format.bits - 1) - 1)).astype(np.int32)
    return complete << (32 - format.bits)


def written(format: WaveFormat, data: np.ndarray, **more: int) -> bytes:
    file = io.BytesIO()
    writer = WaveWriter(file, format, len(data), STAMP, **more)
    for start in range(0, len(data), 100):
        writer.write(data[start : start + 100])
    writer.close()
    return file.getvalue()


def chunks(data: bytes) -> list[tuple[bytes, int, bytes]]:
    position, result = 12, []
    while position < len(data):
        size = struct.unpack("<I", data[position + 4 : position + 8])[0]
        result.append(
            (data[position : position + 4], size, data[position + 8 : position + 8 + size])
        )
        position += 8 + size + (size & 1)
    return result


@pytest.mark.parametrize("bits", [16, 24, "float"])
@pytest.mark.parametrize("n_channels", [1, 2, 3, 24, 64])
def test_written_wave_read_by_libsndfile(tmp_path: Path, bits, n_channels: int) -> None:
    format = WaveFormat(44_100, n_channels, bits)
    data = samples(format, 333)
    path = tmp_path / "x.wav"
    path.write_bytes(written(format, data))
    dtype = "float32" if bits == "float" else "int32"
    back, rate = soundfile.read(path, dtype=dtype, always_2d=True)
    info = soundfile.info(path)
    assert (info.format, info.subtype, rate) == ("WAVEX", SUBTYPES[bits], 44_100)
    np.testing.assert_array_equal(back, data)


@pytest.mark.parametrize("bits", [16, 24, "float"])
def test_rf64_is_read_by_libsndfile(tmp_path: Path, bits) -> None:
    format = WaveFormat(48_000, 5, bits)
    data = samples(format, 201)
    path = tmp_path / "x.wav"
    path.write_bytes(written(format, data, riff_limit=1000))
    assert path.read_bytes()[:4] == b"RF64"
    assert soundfile.info(path).format == "RF64"
    back, _ = soundfile.read(path, dtype="float32" if bits == "float" else "int32", always_2d=True)
    np.testing.assert_array_equal(back, data)
    info = read_info(path)
    assert (info.container, info.n_frames, info.score) == ("RF64", 201, HASH)


def test_header_changes_over_at_four_gigabytes() -> None:
    format = WaveFormat(44_100, 24, 24)
    overhead = len(pack(format, 0, STAMP)) - 8
    fits = (2**32 - 1 - overhead) // format.frame_bytes
    assert pack(format, fits, STAMP)[:4] == b"RIFF"
    long = pack(format, fits + 1, STAMP)
    assert long[:4] == b"RF64"
    riff, size, n_frames, n_tables = struct.unpack("<QQQI", long[20:48])
    assert long[12:16] == b"ds64"
    assert (size, n_frames, n_tables) == ((fits + 1) * 72, fits + 1, 0)
    assert riff == len(long) - 8 + size
    assert long[-4:] == b"\xff\xff\xff\xff"


def test_wave_header_layout_in_bytes() -> None:
    format = WaveFormat(44_100, 24, "float")
    data = written(format, samples(format, 10))
    names = [(name, size) for name, size, _ in chunks(data)]
    assert names == [(b"JUNK", 28), (b"fmt ", 40), (b"fact", 4), (b"bext", 602), (b"data", 960)]
    assert struct.unpack("<I", data[4:8])[0] == len(data) - 8
    fmt = dict((name, content) for name, _, content in chunks(data))[b"fmt "]
    assert struct.unpack("<HHIIHH", fmt[:16]) == (0xFFFE, 24, 44_100, 44_100 * 96, 96, 32)
    # IEEE_FLOAT of ksmedia.h: 00000003-0000-0010-8000-00aa00389b71
    assert fmt[24:].hex() == "0300000000001000800000aa00389b71"


def test_broadcast_extension_as_ebu_3285_lays_it_out() -> None:
    format = WaveFormat(44_100, 1, 16)
    bext = dict((name, c) for name, _, c in chunks(written(format, samples(format, 3))))[b"bext"]
    assert bext[:256].rstrip(b"\0").decode() == f"Étude for one bell score {HASH}"
    assert bext[256:288].rstrip(b"\0") == b"ergon"
    assert bext[320:338] == b"1970-01-0100:00:00"
    assert struct.unpack("<Q", bext[338:346]) == (0,)
    assert struct.unpack("<H", bext[346:348]) == (1,)
    assert bext[348:] == bytes(254)


def test_long_title_preserves_hash() -> None:
    stamp = Stamp("é" * 400, HASH)
    file = io.BytesIO(pack(WaveFormat(44_100, 1, 16), 0, stamp))
    info = parse(file)
    assert info.score == HASH
    assert set(info.title) == {"é"}


def test_wave_odd_data_size_is_padded() -> None:
    format = WaveFormat(44_100, 1, 24)
    data = written(format, samples(format, 3))
    assert len(data) % 2 == 0
    assert struct.unpack("<I", data[4:8])[0] == len(data) - 8


def test_writes_in_blocks_give_identical_bytes() -> None:
    format = WaveFormat(44_100, 2, "float")
    data = samples(format, 1000)
    file = io.BytesIO()
    writer = WaveWriter(file, format, 1000, STAMP)
    writer.write(data)
    writer.close()
    assert file.getvalue() == written(format, data)


def test_read_blocks_and_hash_of_written_wave(tmp_path: Path) -> None:
    for bits in (16, 24, "float"):
        format = WaveFormat(44_100, 2, bits)
        data = samples(format, 70_000)
        path = tmp_path / f"{bits}.wav"
        path.write_bytes(written(format, data))
        want, _ = soundfile.read(path, dtype="float64")
        np.testing.assert_array_equal(np.concatenate(list(read_blocks(path))), want)
        body = path.read_bytes()[read_info(path).samples_offset :]
        assert hash_samples(path) == hashlib.sha256(body).hexdigest()
        assert is_render(path)


def test_read_info_of_foreign_wave_file(tmp_path: Path) -> None:
    path = tmp_path / "x.wav"
    soundfile.write(path, np.zeros((10, 2)), 44_100, subtype="PCM_16")
    info = read_info(path)
    assert (info.n_frames, info.format.n_channels, info.originator) == (10, 2, None)
    assert info.score is None
    assert not is_render(path)


@pytest.mark.parametrize(
    "data",
    [b"", b"RIFF", b"no sound", b"RIFF\0\0\0\0WAVE", b"RIFF\0\0\0\0WAVEfmt \x10\0\0\0\1"],
)
def test_malformed_wave_files_are_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.wav"
    path.write_bytes(data)
    with pytest.raises(NotWaveError):
        read_info(path)


def struck(n_frames: int = 1000, n_channels: int = 2) -> np.ndarray:
    return np.random.default_rng(5).uniform(-0.9, 0.9, (n_frames, n_channels))


def plain(data: np.ndarray, **more: object) -> bytes:
    """A file as libsndfile writes it, with a head of 44 bytes before its samples."""
    file = io.BytesIO()
    soundfile.write(file, data, 44_100, format="WAV", **more)
    return file.getvalue()


@pytest.mark.parametrize("subtype", ["PCM_U8", "PCM_16", "PCM_24", "PCM_32", "FLOAT", "DOUBLE"])
@pytest.mark.parametrize("form", ["WAV", "WAVEX", "RF64"])
def test_samples_of_every_format_equal_libsndfile(tmp_path: Path, subtype, form):
    path = tmp_path / "x.wav"
    soundfile.write(path, struck(), 44_100, format=form, subtype=subtype)
    expected, _ = soundfile.read(path, always_2d=True)
    np.testing.assert_array_equal(np.concatenate([*read_blocks(path)]), expected)
    assert read_info(path).damage is None


def test_bw64_is_rf64_by_another_name(tmp_path: Path):
    """ITU-R BS.2088: the same chunks, another first word."""
    path = tmp_path / "x.wav"
    soundfile.write(path, struck(), 44_100, format="RF64", subtype="PCM_24")
    expected = np.concatenate([*read_blocks(path)])
    path.write_bytes(b"BW64" + path.read_bytes()[4:])
    assert read_info(path).container == "BW64"
    np.testing.assert_array_equal(np.concatenate([*read_blocks(path)]), expected)
    take = read_take(path, "2")
    np.testing.assert_array_equal(take.x, expected[:, 1])


@pytest.mark.parametrize("riff", [0, 36, 0xFFFFFFFF])
@pytest.mark.parametrize("size", [0, 0xFFFFFFFF, 0x7FFFF000])
def test_wave_size_left_by_pipe_means_to_end(tmp_path: Path, riff: int, size: int):
    data = bytearray(plain(struck(), subtype="PCM_16"))
    assert data[36:40] == b"data"
    data[4:8], data[40:44] = riff.to_bytes(4, "little"), size.to_bytes(4, "little")
    path = tmp_path / "x.wav"
    path.write_bytes(data)
    info = read_info(path)
    assert (info.n_frames, info.damage) == (1000, None)
    if size != 0x7FFFF000:
        assert len(read_take(path, "1").x) == 1000


@pytest.mark.parametrize("size", [0, 0xFFFFFFFF])
@pytest.mark.parametrize("late_sizes", [(26,), (5, 26), (604,)])
def test_wave_of_a_pipe_ends_before_late_chunks(tmp_path: Path, size: int, late_sizes):
    """As a program writes a LIST behind samples of which it does not say the size."""
    data = bytearray(plain(struck(), subtype="PCM_16"))
    data[4:8] = data[40:44] = size.to_bytes(4, "little")
    for late_size in late_sizes:
        data += b"LIST" + late_size.to_bytes(4, "little") + b"INFOI".ljust(late_size, b"\0")
        data += bytes(late_size % 2)
    path = tmp_path / "x.wav"
    path.write_bytes(data)
    info = read_info(path)
    assert (info.n_frames, info.damage) == (1000, None)
    assert info.unread_chunks == tuple(("LIST", late_size) for late_size in late_sizes)


def test_empty_wave_file_followed_by_chunk(tmp_path: Path):
    """What follows its samples is no sound."""
    head = plain(struck(0), subtype="PCM_16")[:44]
    data = head + b"LIST" + (20).to_bytes(4, "little") + bytes(20)
    data = data[:4] + (len(data) - 8).to_bytes(4, "little") + data[8:]
    path = tmp_path / "x.wav"
    path.write_bytes(data)
    assert read_info(path).n_frames == 0


def test_cut_wave_file_reports_damage(tmp_path: Path):
    path = tmp_path / "x.wav"
    path.write_bytes(plain(struck(), subtype="PCM_16")[: 44 + 4 * 300])
    info = read_info(path)
    assert info.n_frames == 300
    assert info.damage == (
        "the file is shorter than its header says: of 1,000 frames 300 are there"
    )


def test_wrong_number_of_frames_or_channels_is_refused() -> None:
    format = WaveFormat(44_100, 2, "float")
    writer = WaveWriter(io.BytesIO(), format, 10, STAMP)
    with pytest.raises(ValueError, match="more than the header"):
        writer.write(np.zeros((11, 2), np.float32))
    with pytest.raises(ValueError, match="channels"):
        writer.write(np.zeros((1, 3), np.float32))
    with pytest.raises(ValueError, match="fewer"):
        writer.close()
    with pytest.raises(ValueError, match="64 channels"):
        pack(WaveFormat(44_100, 65, 24), 1, STAMP)


def test_pack_with_marks_as_cue_points(tmp_path: Path) -> None:
    """Two cue points and their names, as the specification of 1991 lays them out; those outside of
    the file are left out.
    """
    form = WaveFormat(44_100, 1, 16)
    marks = (("early", -1), ("in", 0), ("koda ü", 3), ("late", 4))
    head = pack(form, 4, Stamp("piece", marks=marks))
    points = struct.pack("<II4sIII", 1, 0, b"data", 0, 0, 0)
    points += struct.pack("<II4sIII", 2, 3, b"data", 0, 0, 3)
    assert struct.pack("<4sII", b"cue ", 52, 2) + points in head
    names = struct.pack("<4sII", b"labl", 7, 1) + b"in\0\0"
    names += struct.pack("<4sII", b"labl", 12, 2) + "koda ü\0".encode()
    assert struct.pack("<4sI4s", b"LIST", 4 + len(names), b"adtl") + names in head
    path = tmp_path / "a.wav"
    path.write_bytes(head + bytes(8))
    assert read_info(path).marks == (("in", 0), ("koda ü", 3))
    assert soundfile.info(path).frames == 4


def test_read_info_with_damaged_cue_points(tmp_path: Path) -> None:
    """A point that is cut, a name longer than its list, and a list without a kind."""
    form = WaveFormat(44_100, 1, 16)
    cue = struct.pack("<4sII", b"cue ", 10, 9) + bytes(6)
    long_name = struct.pack("<4sI4s4sII", b"LIST", 16, b"adtl", b"labl", 999, 1)
    empty = struct.pack("<4sI", b"LIST", 0)
    stamp = Stamp("piece", chunks=cue + long_name + empty)
    path = tmp_path / "a.wav"
    path.write_bytes(pack(form, 2, stamp) + bytes(4))
    info = read_info(path)
    assert (info.marks, info.n_frames) == ((), 2)
