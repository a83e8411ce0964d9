"""The chunks of a WAVE file, written and read: RIFF or RF64, extensible format, broadcast data.

`core-rs/live/src/audio/wave.rs` writes the same header for float samples: a performance records
without Python, so no interpreter runs between its sound and the disk. It reads nothing.

Sources: Microsoft, "Multiple channel audio data and WAVE files" (WAVE_FORMAT_EXTENSIBLE); EBU Tech
3306 (RF64 and ds64); ITU-R BS.2088 (BW64, the same by another name); EBU Tech 3285
(bext). They are written here and not by libsndfile because that needs to seek (no pipe), puts its
own version into `bext`, and stamps the clock into float files.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import BinaryIO, Literal

from ergon.common.errors import ErgonError
from ergon.common.foreign_files import foreign_form

from .streamed import samples_end
from .track_names import ixml_content, track_names

Bits = Literal[8, 16, 24, 32, "float", "double"]  # 8, 32 and double are read, not written

ORIGINATOR = "ergon"
CHANNELS_MAX = 64
# A RIFF size field has 32 bits; above this the file says its sizes in ds64 (EBU Tech 3306, 3).
RIFF_LIMIT = 2**32 - 1
BYTES_BY_FORM: dict[Bits, int] = {8: 1, 16: 2, 24: 3, 32: 4, "float": 4, "double": 8}
_Container = Literal["RIFF", "RIFX", "RF64", "BW64", "FLAC", "AIFF", "AIFC"]
_CONTAINERS: dict[bytes, _Container] = {
    b"RIFF": "RIFF",
    b"RIFX": "RIFX",  # big-endian numbers
    b"RF64": "RF64",
    b"BW64": "BW64",
}
_Order = Literal["little", "big"]
_ORDER_SIGNS: dict[_Order, str] = {"little": "<", "big": ">"}
_STREAMED_SIZES = (0, 0xFFFFFFFF)  # sizes left by programs that cannot seek back to write them
_SOX_STREAMED_SIZE = 0x7FFFF000  # SoX's value, rounded down to whole frames (its wav.c)

_TAG_PCM, _TAG_FLOAT, _TAG_EXTENSIBLE = 1, 3, 0xFFFE
_GUID_TAIL = bytes.fromhex("000000001000800000aa00389b71")  # KSDATAFORMAT_SUBTYPE_*
_SPEAKER_MASKS = {1: 0x4, 2: 0x3}  # centre; left and right; more channels go out direct, unnamed
_DS64_FORMAT = struct.Struct("<QQQI")
_FMT_FORMAT = struct.Struct("<HHIIHHHHI")
# Version 1: the last field is 64 bytes of UMID and 190 reserved, all zero.
_BEXT_FORMAT = struct.Struct("<256s32s32s10s8sQH254s")
# Number, position, chunk, start of the chunk, start of the block, frame in the block.
_CUE_FORMAT = struct.Struct("<II4sIII")
_BEXT_DATE, _BEXT_TIME = b"1970-01-01", b"00:00:00"  # never the clock: same score, same bytes
_DESCRIPTION_MAX = 4 << 20  # bytes of a description of channels; longer ones are ignored
_CUES_MAX = 1 << 20  # bytes of cue points, and of their names; more are ignored
_OTHERS_MAX = 100  # most chunks that are listed as not read
# Chunks that may follow one of odd size whose filling byte is missing.
_COMMON_CHUNKS = (b"fmt ", b"data", b"LIST", b"fact", b"bext", b"iXML", b"axml", b"chna", b"cue ")
# Chunks that may follow samples without a stated size, in a file that was written into a pipe.
_LATE_CHUNKS = (*_COMMON_CHUNKS[2:], b"smpl", b"inst", b"id3 ", b"ID3 ", b"_PMX", b"JUNK", b"junk")
# Codings of samples, by their tags (RFC 2361).
_CODING_NAMES = {2: "ADPCM", 6: "A-law", 7: "µ-law", 17: "IMA ADPCM", 49: "GSM", 85: "MP3"}
_IGNORED_CHUNKS = (b"JUNK", b"junk", b"PAD ", b"FLLR", b"fact")  # chunks without information
_CUT_HEADER_MESSAGE = "this WAVE file ends within its header"
_SCORE_HASH_PATTERN = re.compile(r"\bscore ([0-9a-f]{64})\b")
_PLAN_HASH_PATTERN = re.compile(r"\bplan ([0-9a-f]{64})\b")


class NotWaveError(ErgonError, ValueError):
    """The bytes are not a WAVE file that this reader knows."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """What a render says of itself: title, hashes of the score and of its plan (64 hex digits)."""

    title: str
    score: str = ""
    plan: str = ""
    chunks: bytes = b""  # the chunks that describe the channels, byte for byte
    marks: tuple[tuple[str, int], ...] = ()  # names and frames in the file, for WAVE files
    tracks: tuple[str, ...] = ()  # names of the channels, for WAVE files

    def description(self) -> bytes:
        """The 256 bytes of the bext description; a long title is cut, a hash never."""
        plan_tail = f" plan {self.plan}".encode() if self.plan else b""
        plan_tail += f" score {self.score}".encode() if self.score else b""
        title = self.title.encode()[: 256 - len(plan_tail)]
        return title.decode("utf-8", "ignore").encode() + plan_tail


@dataclass(frozen=True, slots=True)
class WaveFormat:
    """Rate [Hz], number of channels and form of the samples."""

    rate: int
    n_channels: int
    bits: Bits

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame."""
        return self.n_channels * BYTES_BY_FORM[self.bits]


@dataclass(frozen=True, slots=True)
class WaveInfo:
    """What a sound file says it holds; `samples_offset` and `samples_size` [bytes] are those of its
    samples.
    """

    container: _Container
    format: WaveFormat
    n_frames: int
    samples_offset: int
    samples_size: int
    originator: str | None = None
    description: str = ""
    axml: bytes = b""
    chna: bytes = b""
    speaker_mask: int = 0  # loudspeakers of the channels (WAVE_FORMAT_EXTENSIBLE); 0: not said
    missing_bytes: int = 0  # bytes of samples that the header announces beyond the end of the file
    unread_chunks: tuple[tuple[str, int], ...] = ()  # chunks that are not read, with their sizes
    marks: tuple[tuple[str, int], ...] = ()  # names and frames
    tracks: tuple[str, ...] = ()  # names of the channels; none where the file gives none

    @property
    def damage(self) -> str | None:
        """What is wrong with a file that can be read all the same; None if it is whole."""
        if not self.missing_bytes:
            return None
        stated_frames = (self.samples_size + self.missing_bytes) // self.format.frame_bytes
        frames = f"of {stated_frames:,} frames {self.n_frames:,} are there"
        return f"the file is shorter than its header says: {frames}"

    @property
    def score(self) -> str | None:
        """Hash of the score that this was rendered from; None if it is not a render of ergon."""
        match = _SCORE_HASH_PATTERN.search(self.description)
        return match[1] if match and self.originator == ORIGINATOR else None

    @property
    def plan(self) -> str | None:
        """Hash of the plan that computed it."""
        match = _PLAN_HASH_PATTERN.search(self.description)
        return match[1] if match and self.originator == ORIGINATOR else None

    @property
    def title(self) -> str:
        """Title of the piece."""
        return _PLAN_HASH_PATTERN.sub("", _SCORE_HASH_PATTERN.sub("", self.description)).strip()


def pack(format: WaveFormat, n_frames: int, stamp: Stamp, *, riff_limit: int = RIFF_LIMIT) -> bytes:
    """Everything before the samples, for a file of exactly `n_frames`.

    In a RIFF file a JUNK chunk of the size of ds64 takes its place (EBU Tech 3306, 3), so both
    containers have the same layout. Raises ValueError for a format that cannot be written.
    """
    if not 1 <= format.n_channels <= CHANNELS_MAX:
        raise ValueError(f"a file has 1 to {CHANNELS_MAX} channels, not {format.n_channels}")
    data_size = n_frames * format.frame_bytes
    originator_bytes = ORIGINATOR.encode()
    chunks_bytes = b"".join(
        (
            _padded_chunk(b"fmt ", _pack_format(format)),
            _padded_chunk(b"fact", struct.pack("<I", min(n_frames, 0xFFFFFFFF))),
            _padded_chunk(
                b"bext",
                _BEXT_FORMAT.pack(
                    stamp.description(), originator_bytes, b"", _BEXT_DATE, _BEXT_TIME, 0, 1, b""
                ),
            ),
            stamp.chunks,
            _padded_chunk(b"iXML", ixml_content(stamp.tracks, stamp.title))
            if stamp.tracks
            else b"",
            _cue_chunks([mark for mark in stamp.marks if 0 <= mark[1] < n_frames]),
        )
    )
    riff = 4 + (8 + _DS64_FORMAT.size) + len(chunks_bytes) + 8 + data_size + (data_size & 1)
    if riff <= riff_limit:
        header = (
            b"RIFF"
            + struct.pack("<I", riff)
            + b"WAVE"
            + _padded_chunk(b"JUNK", bytes(_DS64_FORMAT.size))
        )
        return header + chunks_bytes + b"data" + struct.pack("<I", data_size)
    ds64 = _padded_chunk(b"ds64", _DS64_FORMAT.pack(riff, data_size, n_frames, 0))
    return b"RF64\xff\xff\xff\xffWAVE" + ds64 + chunks_bytes + b"data\xff\xff\xff\xff"


def _cue_chunks(marks: Sequence[tuple[str, int]]) -> bytes:
    """Cue points and their names (`cue `, and `labl` in a LIST of `adtl`); nothing without marks.

    A frame past 32 bits has no place in them and is left out. The layout is that of Microsoft and
    IBM, "Multimedia programming interface and data specifications 1.0" (1991).
    """
    placed_marks = [(name, frame) for name, frame in marks if frame <= 0xFFFFFFFF]
    if not placed_marks:
        return b""
    cue_points = (
        _CUE_FORMAT.pack(number, frame, b"data", 0, 0, frame)
        for number, (_, frame) in enumerate(placed_marks, 1)
    )
    labels = (
        _padded_chunk(b"labl", struct.pack("<I", number) + name.encode() + b"\0")
        for number, (name, _) in enumerate(placed_marks, 1)
    )
    cue = struct.pack("<I", len(placed_marks)) + b"".join(cue_points)
    return _padded_chunk(b"cue ", cue) + _padded_chunk(b"LIST", b"adtl" + b"".join(labels))


def _padded_chunk(name: bytes, content: bytes) -> bytes:
    return name + struct.pack("<I", len(content)) + content + bytes(len(content) & 1)


def _pack_format(format: WaveFormat) -> bytes:
    n_bits = 8 * BYTES_BY_FORM[format.bits]
    return (
        _FMT_FORMAT.pack(
            _TAG_EXTENSIBLE,
            format.n_channels,
            format.rate,
            format.rate * format.frame_bytes,
            format.frame_bytes,
            n_bits,
            22,  # bytes that follow
            n_bits,
            _SPEAKER_MASKS.get(format.n_channels, 0),
        )
        + struct.pack("<H", _TAG_FLOAT if format.bits in ("float", "double") else _TAG_PCM)
        + _GUID_TAIL
    )


def parse(open_file: BinaryIO) -> WaveInfo:
    """Read the chunks of a seekable file. Raises NotWaveError with a sentence."""
    header_bytes = open_file.read(12)
    container = _container(header_bytes)
    format: WaveFormat | None = None
    long_size, long_riff_size, mask = 0, 0, 0
    byte_order: _Order = "big" if container == "RIFX" else "little"
    riff_size = int.from_bytes(header_bytes[4:8], byte_order)
    originator: str | None = None
    description = ""
    descriptions = {b"axml": b"", b"chna": b"", b"iXML": b""}
    other_chunks: list[tuple[str, int]] = []
    cues: dict[int, int] = {}
    cue_labels: dict[int, str] = {}
    sample_span: tuple[int, int, int] | None = None  # offset, bytes present, bytes missing
    file_end = open_file.seek(0, 2)
    open_file.seek(12)
    while len(chunk := open_file.read(8)) == 8:
        chunk_name, chunk_size = chunk[:4], int.from_bytes(chunk[4:], byte_order)
        start_offset = open_file.tell()
        if sample_span is not None and (
            chunk_size > file_end - start_offset or not chunk_name.isascii()
        ):
            break  # the bytes after the samples are no chunk
        if chunk_name == b"data" and sample_span is None:
            if format is None:
                raise NotWaveError("the samples come before their format")
            if chunk_size == 0xFFFFFFFF and container in ("RF64", "BW64"):
                chunk_size, riff_size = long_size, long_riff_size
            bytes_present, missing_bytes = _sample_bytes_and_missing(
                open_file, chunk_size, format, byte_order, is_whole=riff_size + 8 == file_end
            )
            sample_span, chunk_size = (start_offset, bytes_present, missing_bytes), bytes_present
        elif chunk_name == b"ds64":
            long_riff_size, long_size, *_ = _DS64_FORMAT.unpack(
                read_exactly(open_file, _DS64_FORMAT.size)
            )
        elif chunk_name == b"fmt ":
            chunk_content = read_exactly(open_file, min(chunk_size, 40))
            format = _parse_format(chunk_content, byte_order)
            if int.from_bytes(chunk_content[:2], byte_order) == _TAG_EXTENSIBLE:
                mask = int.from_bytes(chunk_content[20:24], byte_order)
        elif chunk_name == b"bext" and chunk_size >= _BEXT_FORMAT.size:
            text, origin, *_ = _BEXT_FORMAT.unpack(read_exactly(open_file, _BEXT_FORMAT.size))
            description, originator = _text_field(text), _text_field(origin)
        elif chunk_name in descriptions and chunk_size <= _DESCRIPTION_MAX:
            descriptions[chunk_name] = read_exactly(open_file, chunk_size)
        elif chunk_name == b"cue " and chunk_size <= _CUES_MAX:
            cues = _cue_frames(read_exactly(open_file, chunk_size), byte_order)
        elif (
            chunk_name == b"LIST" and 4 <= chunk_size <= _CUES_MAX and open_file.read(4) == b"adtl"
        ):
            cue_labels = _cue_names(read_exactly(open_file, chunk_size - 4), byte_order)
        elif chunk_name not in _IGNORED_CHUNKS and len(other_chunks) < _OTHERS_MAX:
            other_chunks.append((chunk_name.decode("latin-1"), chunk_size))
        open_file.seek(_next_chunk(open_file, start_offset + chunk_size))
    if sample_span is None or format is None:
        raise NotWaveError("this WAVE file holds no samples")
    sample_offset, chunk_size, missing_bytes = sample_span
    channel_names = track_names(descriptions[b"iXML"], format.n_channels)
    if descriptions[b"iXML"] and not channel_names:  # nothing of it is understood
        other_chunks.append(("iXML", len(descriptions[b"iXML"])))
    return WaveInfo(
        container,
        format,
        chunk_size // format.frame_bytes,
        sample_offset,
        chunk_size,
        originator,
        description,
        descriptions[b"axml"],
        descriptions[b"chna"],
        mask,
        missing_bytes,
        tuple(other_chunks),
        tuple((cue_labels.get(number, str(number)), frame) for number, frame in cues.items()),
        channel_names,
    )


def _container(header_bytes: bytes) -> _Container:
    """The container of a WAVE file by its first 12 bytes. Raises NotWaveError."""
    if (foreign_kind := foreign_form(header_bytes)) is not None:
        raise NotWaveError(foreign_kind)
    if len(header_bytes) < 12 or header_bytes[:4] not in _CONTAINERS or header_bytes[8:] != b"WAVE":
        raise NotWaveError("this is not a WAVE file")
    return _CONTAINERS[header_bytes[:4]]


def _next_chunk(open_file: BinaryIO, end_offset: int) -> int:
    """Where the chunk after one that ends at an offset begins: some programs leave out the byte
    that fills a chunk of odd size.
    """
    if not end_offset & 1:
        return end_offset
    open_file.seek(end_offset)
    next_bytes = open_file.read(5)
    is_bare = next_bytes[:4] in _COMMON_CHUNKS and next_bytes[1:] not in _COMMON_CHUNKS
    return end_offset if is_bare else end_offset + 1


def _cue_frames(cue_content: bytes, order: _Order) -> dict[int, int]:
    """The frames of cue points, by their numbers."""
    cue = struct.Struct(_CUE_FORMAT.format.replace("<", _ORDER_SIGNS[order]))
    starts = range(4, len(cue_content) - cue.size + 1, cue.size)
    points = (cue.unpack_from(cue_content, start) for start in starts)
    return {number: frame for number, *_, frame in points}


def _cue_names(chunk_content: bytes, byte_order: _Order) -> dict[int, str]:
    """The names of cue points, by their numbers."""
    names_by_number: dict[int, str] = {}
    label_start, form = 0, f"{_ORDER_SIGNS[byte_order]}4sII"
    while label_start + 12 <= len(chunk_content):
        kind, label_size, number = struct.unpack_from(form, chunk_content, label_start)
        if kind == b"labl" and label_size >= 4:
            names_by_number[number] = _text_field(
                chunk_content[label_start + 12 : label_start + 8 + label_size]
            )
        label_start += 8 + label_size + (label_size & 1)
    return names_by_number


def _sample_bytes_and_missing(
    open_file: BinaryIO, stated: int, format: WaveFormat, byte_order: _Order, *, is_whole: bool
) -> tuple[int, int]:
    """Bytes of the samples, which begin where a file is, and how many the header states that are
    not there.

    `is_whole`: the size of the whole file is true, so that a size of 0 is one, too.
    """
    start_offset = open_file.tell()
    bytes_present = open_file.seek(0, 2) - start_offset
    is_sox = _SOX_STREAMED_SIZE - format.frame_bytes < stated <= _SOX_STREAMED_SIZE
    if stated in _STREAMED_SIZES and not (is_whole and not stated):
        stop = samples_end(open_file, start_offset, _LATE_CHUNKS, is_big=byte_order == "big")
        return stop - start_offset, 0
    if (is_sox and stated > bytes_present) or stated == 0xFFFFFFFFFFFFFFFF:
        return bytes_present, 0
    return min(stated, bytes_present), max(0, stated - bytes_present)


def read_exactly(file: BinaryIO, n_bytes: int, refusal: str = _CUT_HEADER_MESSAGE) -> bytes:
    """So many bytes of a file. Raises NotWaveError, saying `refusal`, if there are fewer."""
    read_data = file.read(n_bytes)
    if len(read_data) < n_bytes:
        raise NotWaveError(refusal)
    return read_data


def _text_field(field: bytes) -> str:
    return field.split(b"\0", 1)[0].decode("utf-8", "replace").strip()


def _parse_format(chunk_content: bytes, byte_order: _Order) -> WaveFormat:
    if len(chunk_content) < 16:
        raise NotWaveError("this WAVE file ends within its header")
    form = f"{_ORDER_SIGNS[byte_order]}HHIIHH"
    tag, n_channels, rate, _, frame_bytes, n_bits = struct.unpack(form, chunk_content[:16])
    if tag == _TAG_EXTENSIBLE and len(chunk_content) >= 40:
        tag = int.from_bytes(chunk_content[24:26], byte_order)
    if tag in _CODING_NAMES:
        raise NotWaveError(
            f"samples coded as {_CODING_NAMES[tag]} are not supported; save it as PCM"
        )
    forms: dict[tuple[int, int], Bits] = {
        (_TAG_PCM, 8): 8,
        (_TAG_PCM, 16): 16,
        (_TAG_PCM, 24): 24,
        (_TAG_PCM, 32): 32,
        (_TAG_FLOAT, 32): "float",
        (_TAG_FLOAT, 64): "double",
    }
    # Samples of 12 or 20 bits are the upper bits of whole bytes.
    n_bytes = -(-n_bits // 8)
    if tag in (_TAG_PCM, _TAG_FLOAT) and frame_bytes not in (0, n_channels * n_bytes):
        raise NotWaveError(
            f"a frame of {n_channels} × {n_bits} bits has {frame_bytes} bytes by its header, not "
            f"{n_channels * n_bytes}; samples in longer words are not supported, because some "
            "programs mean floats by them; save it as PCM of 16, 24 or 32 bits"
        )
    bits = forms.get((tag, 8 * n_bytes if tag == _TAG_PCM and frame_bytes else n_bits))
    if bits is None or not n_channels or not rate:
        raise NotWaveError(f"samples of {n_bits} bits with format tag {tag} are not supported")
    return WaveFormat(rate, n_channels, bits)
