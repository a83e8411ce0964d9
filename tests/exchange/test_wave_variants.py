"""WAVE files as other programs write them, read by ours and by libsndfile."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import numpy as np
import pytest
import soundfile

from ergon.exchange import adm, sound
from ergon.exchange.wave_header import NotWaveError

_GUID_TAIL = bytes.fromhex("000000001000800000aa00389b71")
_FORMS = [(1, 8, 1), (1, 16, 2), (1, 24, 3), (1, 32, 4), (3, 32, 4), (3, 64, 8), (1, 20, 3),
          (1, 12, 2)]  # fmt: skip  # tag, bits, bytes
_CHUNKS = [b"JUNK", b"LIST", b"bext", b"cue ", b"PAD ", b"fact", b"PEAK", b"iXML", b"smpl", b"_PMX"]


def _chunk(name: bytes, content: bytes, size: int | None = None) -> bytes:
    stated = len(content) if size is None else size
    return name + struct.pack("<I", stated) + content + bytes(len(content) & 1)


def _others(chance: random.Random) -> bytes:
    """Chunks that say nothing of the samples, some of odd sizes."""
    chunks = b""
    for _ in range(chance.randrange(4)):
        name, size = chance.choice(_CHUNKS), chance.choice([0, 1, 7, 16, 603, 1024])
        content = chance.randbytes(size)
        if name == b"LIST":
            content = b"INFOISFT\x05\0\0\0Lavf\0\0" + bytes(chance.choice([0, 1]))
        if name == b"fact":
            content = struct.pack("<I", chance.choice([0, 10]))
        if name in (
            b"smpl",
            b"cue ",
            b"PEAK",
            b"iXML",
            b"bext",
        ):  # of the sizes that they must have
            content = {b"smpl": bytes(36), b"cue ": bytes(4), b"PEAK": struct.pack("<II", 1, 0),
                       b"iXML": b"<BWFXML/>", b"bext": bytes(602)}[name]  # fmt: skip
        chunks += _chunk(name, content)
    return chunks


def _variant(seed: int) -> tuple[bytes, bytes, str]:
    """The bytes of a file, the same samples without anything odd, and what is odd."""
    chance = random.Random(seed)
    tag, bits, width = _FORMS[seed % len(_FORMS)]
    channels, n, rate = chance.choice([1, 2, 3, 6]), chance.randrange(1, 300), 44100
    samples = np.random.default_rng(seed).uniform(-0.9, 0.9, (n, channels))
    if tag == 3:
        data = samples.astype(f"<f{width}").tobytes()
    else:
        complete = (samples * 2.0 ** (8 * width - 1)).astype("<i8") >> (8 * width - bits)
        complete <<= 8 * width - bits
        raw = (complete + 128 if width == 1 else complete).reshape(-1, 1).view("u1")
        data = raw[:, :width].tobytes()
    container = chance.choice(["RIFF", "RIFF", "RF64", "BW64"])
    is_long = container != "RIFF"
    fmt = struct.pack(
        "<HHIIHH", tag, channels, rate, rate * channels * width, channels * width, bits
    )
    kind = chance.choice([16, 18, 40]) if bits % 8 == 0 else 16
    if kind == 18:
        fmt += b"\0\0"
    if kind == 40:
        mask = chance.choice([0, (1 << channels) - 1])
        fmt = struct.pack("<H", 0xFFFE) + fmt[2:]
        fmt += struct.pack("<HHIH", 22, bits, mask, tag) + _GUID_TAIL
    plain = _chunk(b"fmt ", fmt) + _chunk(b"data", data)
    plain = b"RIFF" + struct.pack("<I", 4 + len(plain)) + b"WAVE" + plain
    stated = len(data)
    odd = (
        chance.choice(["", "", "size 0", "size -1", "no size of the whole"]) if not is_long else ""
    )
    if odd == "size -1" or is_long:
        stated = 0xFFFFFFFF
    if odd == "size 0":
        stated = 0
    before, after = _others(chance), _others(chance) if not odd.startswith("size") else b""
    body = before + _chunk(b"fmt ", fmt) + _others(chance)
    body += b"data" + struct.pack("<I", stated) + data
    body += (bytes(len(data) & 1) + after) if after else b""
    if is_long:
        ds64 = struct.pack("<QQQI", 4 + 36 + len(body), len(data), n, 0)
        body = _chunk(b"ds64", ds64) + body
    size = 4 + len(body)
    if is_long:
        size = 0xFFFFFFFF
    elif odd:
        size = chance.choice([0, 0xFFFFFFFF])
    words = f"{container} {tag}/{bits}/{width} fmt {kind} {odd} {len(before)} before"
    return container.encode() + struct.pack("<I", size) + b"WAVE" + body, plain, words


@pytest.mark.parametrize("seed", range(64))
def test_wave_files_of_other_programs(seed: int, tmp_path: Path) -> None:
    data, plain, words = _variant(seed)
    path, other = tmp_path / "x.wav", tmp_path / "plain.wav"
    path.write_bytes(data)
    other.write_bytes(plain)  # libsndfile reads neither sizes of 0 nor odd chunks in RF64
    ours = np.concatenate([*sound.read_blocks(path)])
    theirs, rate = soundfile.read(other, always_2d=True)
    info = sound.read_info(path)
    assert (info.format.rate, info.n_frames, info.damage) == (rate, len(theirs), None), words
    assert np.array_equal(ours, theirs), words


@pytest.mark.parametrize(("tag", "bits"), [(7, 8), (6, 8), (2, 4), (0x55, 0), (1, 40), (3, 24)])
def test_wave_files_of_other_codings_are_refused(tag: int, bits: int, tmp_path: Path) -> None:
    data, _, _ = _variant(1)
    place = data.index(b"fmt ") + 8
    fmt = struct.pack("<HHIIHH", tag, 1, 8000, 8000, -(-bits // 8), bits)
    path = tmp_path / "x.wav"
    path.write_bytes(data[:place] + fmt + data[place + 16 :])
    with pytest.raises(NotWaveError, match="are not supported"):
        sound.read_info(path)


def test_wave_files_with_samples_in_longer_words_are_refused(tmp_path: Path) -> None:
    """Some programs mean whole numbers by it, others floats."""
    data, _, _ = _variant(2)
    place = data.index(b"fmt ") + 8
    fmt = struct.pack("<HHIIHH", 1, 2, 8000, 64000, 8, 24)
    path = tmp_path / "x.wav"
    path.write_bytes(data[:place] + fmt + data[place + 16 :])
    with pytest.raises(NotWaveError, match="2 × 24 bits has 8 bytes by its header, not 6"):
        sound.read_info(path)


def test_adm_chunks_behind_samples(tmp_path: Path) -> None:
    """As the EBU renderer and mixing desks write it."""
    described = adm.chunks(adm.ChannelLayout(((30.0, 0.0, 2.0), (-30.0, 0.0, 2.0))), "x")
    fmt = _chunk(b"fmt ", struct.pack("<HHIIHH", 1, 2, 8000, 32000, 4, 16))
    body = fmt + _chunk(b"data", bytes(40)) + _chunk(b"iXML", b"<BWFXML/>") + described
    path = tmp_path / "x.wav"
    path.write_bytes(b"RIFF" + struct.pack("<I", 4 + len(body)) + b"WAVE" + body + b"\0junk")
    info = sound.read_info(path)
    assert (info.n_frames, info.unread_chunks) == (10, (("iXML", 9),))
    layout = adm.read(info)
    assert layout is not None
    assert [place[0] for place in layout.speakers] == pytest.approx([30.0, -30.0])


@pytest.mark.parametrize(("tag", "bits"), [(1, 8), (1, 16), (1, 24), (1, 32), (3, 32), (3, 64)])
def test_wave_file_of_big_endian_numbers(tag: int, bits: int, tmp_path: Path) -> None:
    """RIFX, of programs on big-endian machines."""
    samples = np.random.default_rng(bits).uniform(-0.9, 0.9, (50, 2))
    if tag == 3:
        data = samples.astype(f">f{bits // 8}").tobytes()
    else:
        complete = (samples * 2.0 ** (bits - 1)).astype(">i8") + (128 if bits == 8 else 0)
        data = complete.reshape(-1, 1).view("u1")[:, 8 - bits // 8 :].tobytes()
    fmt = struct.pack(">HHIIHH", tag, 2, 44100, 44100 * bits // 4, bits // 4, bits)
    body = b"WAVEfmt " + struct.pack(">I", 16) + fmt + b"data" + struct.pack(">I", len(data)) + data
    path = tmp_path / "x.wav"
    path.write_bytes(b"RIFX" + struct.pack(">I", len(body)) + body)
    theirs, rate = soundfile.read(path, always_2d=True)
    info = sound.read_info(path)
    assert (info.container, info.format.rate, info.n_frames) == ("RIFX", rate, 50)
    assert np.array_equal(np.concatenate([*sound.read_blocks(path)]), theirs)


def test_wave_chunk_of_odd_size_without_filling_byte(tmp_path: Path) -> None:
    """Some programs leave it out; others write it, whatever stands in it."""
    fmt = _chunk(b"fmt ", struct.pack("<HHIIHH", 1, 1, 8000, 16000, 2, 16))
    for filling in (b"", b"\0", b"f"):
        note = b"note" + struct.pack("<I", 3) + b"abc" + filling
        body = b"WAVE" + note + fmt + _chunk(b"data", bytes(40))
        path = tmp_path / "x.wav"
        path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)
        info = sound.read_info(path)
        assert (info.n_frames, info.unread_chunks) == (20, (("note", 3),)), filling


def test_wave_coding_is_named(tmp_path: Path) -> None:
    path = tmp_path / "x.wav"
    soundfile.write(path, np.zeros(10), 8000, subtype="ALAW")
    with pytest.raises(NotWaveError, match="coded as A-law are not supported; save it as PCM"):
        sound.read_info(path)
