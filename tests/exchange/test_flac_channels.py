"""What the channels of a FLAC file are, beside the WAVE file of the same samples."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import soundfile
from commands import forked

from ergon.exchange import adm, sound
from ergon.exchange.wave_header import Stamp, WaveFormat

FORMAT = WaveFormat(44_100, 8, 24)
RING = adm.ChannelLayout(tuple((45.0 * i, 10.0, 2.0) for i in range(8)))
FRAMES = np.random.default_rng(1).integers(-(2**22), 2**22, (3_000, 8)).astype(np.int32) << 8


def written(path: Path, chunks: bytes) -> None:
    with path.open("w+b") as file:
        writer = sound.writer(str(path), file, FORMAT, len(FRAMES), Stamp("Ring", chunks=chunks))
        writer.write(FRAMES)
        writer.close()


def metadata(data: bytes) -> tuple[list[tuple[int, bytes]], bytes]:
    """The blocks of a FLAC file (RFC 9639, section 8.1), and the frames behind them."""
    assert data[:4] == b"fLaC"
    blocks, start, is_last = [], 4, False
    while not is_last:
        (head,) = struct.unpack_from(">I", data, start)
        is_last, kind, size = bool(head >> 31), head >> 24 & 0x7F, head & 0xFFFFFF
        blocks.append((kind, data[start + 4 : start + 4 + size]))
        start += 4 + size
    return blocks, data[start:]


def joined(blocks: list[tuple[int, bytes]], frames: bytes) -> bytes:
    heads = [
        struct.pack(">I", kind << 24 | len(content) | (number == len(blocks)) << 31)
        for number, (kind, content) in enumerate(blocks, 1)
    ]
    pairs = zip(heads, (content for _, content in blocks), strict=True)
    return b"fLaC" + b"".join(head + content for head, content in pairs) + frames


def commented(path: Path, comment: str) -> None:
    """Replace all comments of a file by one."""
    blocks, frames = metadata(path.read_bytes())
    text = comment.encode()
    content = struct.pack("<I", 0) + struct.pack("<II", 1, len(text)) + text
    path.write_bytes(joined([(k, content if k == 4 else c) for k, c in blocks], frames))


def test_flac_foreign_metadata_rebuilds_wave_file(tmp_path: Path):
    """As `flac -d --keep-foreign-metadata` builds it: the pieces in their order, then samples."""
    chunks = adm.chunks(RING, "Ring")
    for end in (".wav", ".flac"):
        written(tmp_path / f"a{end}", chunks)
    blocks, _ = metadata((tmp_path / "a.flac").read_bytes())
    pieces = [content[4:] for kind, content in blocks if kind == 2 and content[:4] == b"riff"]
    assert [piece[:4] for piece in pieces[:1] + pieces[-1:]] == [b"RIFF", b"data"]
    samples = FRAMES.view(np.uint8).reshape(-1, 4)[:, 1:].tobytes()
    assert b"".join(pieces) + samples == (tmp_path / "a.wav").read_bytes()
    read, _ = soundfile.read(tmp_path / "a.flac", dtype="int32")
    assert np.array_equal(read, FRAMES)


@pytest.mark.parametrize("layout", [RING, adm.ChannelLayout(order=1)])
def test_flac_layout_equals_wave_layout(tmp_path: Path, layout):
    for end in (".wav", ".flac"):
        written(tmp_path / f"a{end}", adm.chunks(layout, "Ring"))
    flac, wav = (sound.read_info(tmp_path / f"a{end}") for end in (".flac", ".wav"))
    assert (flac.axml, flac.chna, flac.unread_chunks) == (wav.axml, wav.chna, wav.unread_chunks)
    assert flac.axml


def test_fold_of_flac_equals_fold_of_wave(tmp_path: Path):
    for end in (".wav", ".flac"):
        written(tmp_path / f"a{end}", adm.chunks(RING, "Ring"))
        words = ("fold", f"a{end}", "--to", "stereo", "-o", f"{end[1:]}.wav")
        done = forked(words, tmp_path)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "flac.wav").read_bytes() == (tmp_path / "wav.wav").read_bytes()


@pytest.mark.parametrize(
    ("comment", "n_speakers", "effects"),
    [
        ("WAVEFORMATEXTENSIBLE_CHANNEL_MASK=0x063F", 7, (3,)),
        ("waveformatextensible_channel_mask=0x6ff", 0, ()),  # ten loudspeakers for eight channels
        ("TITLE=Ring", 7, (3,)),  # RFC 9639, section 9.1.3
        ("WAVEFORMATEXTENSIBLE_CHANNEL_MASK=0x0", 0, ()),
    ],
)
def test_channel_mask_in_a_flac_comment(tmp_path: Path, comment, n_speakers, effects):
    """7.1 as the program `flac` writes it."""
    written(tmp_path / "a.flac", b"")
    commented(tmp_path / "a.flac", comment)
    layout = adm.read(sound.read_info(tmp_path / "a.flac")) or adm.ChannelLayout()
    assert (len(layout.speakers), layout.effects) == (n_speakers, effects)
    read, _ = soundfile.read(tmp_path / "a.flac", dtype="int32")
    assert np.array_equal(read, FRAMES)


_LEFT, _RIGHT, _MIDDLE = (30.0, 0.0, 1.0), (-30.0, 0.0, 1.0), (0.0, 0.0, 1.0)
_AROUND = ((110.0, 0.0, 1.0), (-110.0, 0.0, 1.0))
_SIDES = ((90.0, 0.0, 1.0), (-90.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("n_channels", "speakers", "effects"),
    [
        (3, (_LEFT, _RIGHT, _MIDDLE), ()),
        (4, (_LEFT, _RIGHT, *_AROUND), ()),
        (5, (_LEFT, _RIGHT, _MIDDLE, *_AROUND), ()),
        (6, (_LEFT, _RIGHT, _MIDDLE, *_AROUND), (3,)),
        (7, (_LEFT, _RIGHT, _MIDDLE, (180.0, 0.0, 1.0), *_SIDES), (3,)),
        (8, (_LEFT, _RIGHT, _MIDDLE, (135.0, 0.0, 1.0), (-135.0, 0.0, 1.0), *_SIDES), (3,)),
    ],
)
def test_flac_without_a_mask_has_the_channels_of_its_format(
    tmp_path: Path, n_channels: int, speakers, effects
):
    """Of libsndfile; RFC 9639, section 9.1.3."""
    soundfile.write(tmp_path / "a.flac", FRAMES[:, :n_channels], 44_100, subtype="PCM_24")
    layout = adm.read(sound.read_info(tmp_path / "a.flac"))
    assert layout == adm.ChannelLayout(speakers, effects=effects)


def test_flac_of_ergon_without_a_layout(tmp_path: Path):
    written(tmp_path / "a.flac", b"")
    assert adm.read(sound.read_info(tmp_path / "a.flac")) is None


def test_flac_blocks_without_a_layout(tmp_path: Path):
    written(tmp_path / "a.flac", b"")
    blocks, _ = metadata((tmp_path / "a.flac").read_bytes())
    assert {kind for kind, _ in blocks}.isdisjoint({2})


def test_damaged_flac_blocks_give_no_layout(tmp_path: Path):
    """The samples are read all the same."""
    path = tmp_path / "a.flac"
    written(path, adm.chunks(RING, "Ring"))
    blocks, frames = metadata(path.read_bytes())
    for number, (kind, content) in enumerate(blocks):
        if kind != 2:
            continue
        for damaged in (content[:7], content[: len(content) // 2], bytes(len(content))):
            changed = [*blocks[:number], (kind, damaged), *blocks[number + 1 :]]
            path.write_bytes(joined(changed, frames))
            assert sound.read_info(path).n_frames == len(FRAMES)
