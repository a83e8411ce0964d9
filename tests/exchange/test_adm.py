"""What a WAVE file says of its channels: there and back, and descriptions from strangers."""

import struct
from dataclasses import replace
from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pytest
from domes import dome

from ergon.common import xml_text
from ergon.exchange import adm
from ergon.exchange.wave import WaveWriter
from ergon.exchange.wave_header import RIFF_LIMIT, Stamp, WaveFormat, WaveInfo, parse
from ergon.space.directions import angles

SPEAKERS = adm.ChannelLayout(tuple(angles(place) for place in dome()))


def written(
    sounded: adm.ChannelLayout, title: str = "A piece", limit: int = RIFF_LIMIT
) -> WaveInfo:
    file = BytesIO()
    stamp = Stamp(title, chunks=adm.chunks(sounded, title))
    format = WaveFormat(48_000, sounded.n_channels, 24)
    writer = WaveWriter(file, format, 5, stamp, riff_limit=limit)
    writer.write(np.zeros((5, sounded.n_channels), np.int32))
    writer.close()
    file.seek(0)
    return parse(file)


@pytest.mark.parametrize("limit", [RIFF_LIMIT, 100], ids=["RIFF", "RF64"])
@pytest.mark.parametrize(
    "sounded", [SPEAKERS, adm.ChannelLayout(order=1), adm.ChannelLayout(order=7)]
)
def test_adm_layout_round_trip(sounded: adm.ChannelLayout, limit: int):
    info = written(sounded, limit=limit)
    assert (info.n_frames, info.container) == (5, "RIFF" if limit == RIFF_LIMIT else "RF64")
    result = adm.read(info)
    assert result is not None
    assert result.order == sounded.order
    np.testing.assert_allclose(result.speakers, sounded.speakers, atol=1e-5)


def test_adm_distances_round_trip():
    sounded = adm.ChannelLayout(((0.0, 0.0, 2.0), (90.0, 10.0, 4.5), (-90.0, 10.0, 4.0)))
    result = adm.read(written(sounded))
    assert result is not None
    np.testing.assert_allclose(result.speakers, sounded.speakers, atol=1e-5)


def test_adm_title_with_special_characters():
    info = written(SPEAKERS, "<&\"'> \x07 \u2028é")
    root = ElementTree.fromstring(info.axml)
    names = {one.get("audioProgrammeName") for one in root.iter() if "Programme" in one.tag}
    assert "<&\"'>  é" in {name.replace("\u2028", "") for name in names if name}


def test_adm_track_stream_and_channel_references():
    """As BS.2076 wants it: chna names tracks, these a stream, this a channel of the pack."""
    info = written(SPEAKERS)
    root = xml_text.parse_xml(info.axml)
    n_tracks, n_uids = struct.unpack_from("<HH", info.chna)
    assert (n_tracks, n_uids, len(info.chna)) == (24, 24, 4 + 24 * 40)
    streams = {one.get("audioStreamFormatID"): one for one in root.iter("audioStreamFormat")}
    pack = next(root.iter("audioPackFormat"))
    channels = [one.text for one in pack.findall("audioChannelFormatIDRef")]
    for i, track in enumerate(root.iter("audioTrackFormat")):
        stream = streams[track.findtext("audioStreamFormatIDRef")]
        assert stream.findtext("audioTrackFormatIDRef") == track.get("audioTrackFormatID")
        assert stream.findtext("audioChannelFormatIDRef") == channels[i]
        row = info.chna[4 + 40 * i : 44 + 40 * i]
        assert row[14:28].decode() == track.get("audioTrackFormatID")
        assert row[2:14].decode() == f"ATU_{i + 1:08x}"


def test_adm_read_without_complete_description():
    info = written(SPEAKERS)
    assert adm.read(replace(info, axml=b"")) is None
    assert adm.read(replace(info, chna=b"")) is None
    assert adm.read(replace(info, chna=info.chna[:-40])) is None, "a channel without a name"
    unknown = info.axml.replace(b"DirectSpeakers", b"Objects").replace(b'"0001" t', b'"0003" t')
    assert adm.read(replace(info, axml=unknown)) is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "document type"),
        (b"<a><b></a>", "well formed"),
        (b"", "empty|well formed"),
        ("<a/>".encode("utf-32"), "UTF-8"),
        ("<a/>".encode("utf-16")[:-1], "UTF-16"),
        (b"<a>" + b"<b/>" * 100_001 + b"</a>", "elements"),
        (b" " * (xml_text.BYTES_MAX + 1), "larger"),
        (b'<?xml version="1.0" encoding="nonsense"?><a/>', "cannot be read|well formed"),
        (b"&xxe;", "well formed"),
    ],
)
def test_hostile_xml_is_refused(text: bytes, words: str):
    with pytest.raises(xml_text.XmlError, match=words):
        xml_text.parse_xml(text)


def test_adm_angles_out_of_range_are_refused():
    info = written(SPEAKERS)
    for bad in (b"nan", b"1e9", b"x"):
        text = info.axml.replace(b'"azimuth">0.000000', b'"azimuth">' + bad, 1)
        with pytest.raises(xml_text.XmlError, match=r"out of range|not a number"):
            adm.read(replace(info, axml=text))


def info_of_tracks(names: list[str], n_channels: int, axml: bytes = b"", mask: int = 0) -> WaveInfo:
    """A file whose tracks have these formats, from the first on."""
    rows = [
        struct.pack("<H12s14s11sx", i, f"ATU_{i:08x}".encode(), name.encode(), b"AP_00010003")
        for i, name in enumerate(names, 1)
    ]
    chna = struct.pack("<HH", len(rows), len(rows)) + b"".join(rows) if rows else b""
    format = WaveFormat(48_000, n_channels, 24)
    return WaveInfo("BW64", format, 1, 0, 3 * n_channels, axml=axml, chna=chna, speaker_mask=mask)


FIVE = ((30.0, 0.0, 1.0), (-30.0, 0.0, 1.0), (0.0, 0.0, 1.0), (110.0, 0.0, 1.0), (-110.0, 0.0, 1.0))
TOP = ((30.0, 30.0, 1.0), (-30.0, 30.0, 1.0), (110.0, 30.0, 1.0), (-110.0, 30.0, 1.0))
SEVEN = (*FIVE[:3], (135.0, 0.0, 1.0), (-135.0, 0.0, 1.0), (90.0, 0.0, 1.0), (-90.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("numbers", "speakers", "effects"),
    [
        ((1, 2), FIVE[:2], ()),
        ((1, 2, 3, 4, 5, 6), FIVE, (3,)),
        ((1, 2, 3, 4, 5, 6, 0xD, 0xF, 0x10, 0x12), (*FIVE, *TOP), (3,)),
        ((3, 0x20, 0x21, 0x28), (FIVE[2], (180.0, 45.0, 1.0)), (1, 2)),
        ((7, 0x24, 0xC), ((22.5, 0.0, 1.0), (25.0, 0.0, 1.0), (0.0, 90.0, 1.0)), ()),
    ],
)
def test_adm_common_definitions_without_description(numbers, speakers, effects):
    """ITU-R BS.2094-2, table 1; packs 2, 3 and 5 among them."""
    names = [f"AT_{0x00010000 + number:08x}_01" for number in numbers]
    layout = adm.read(info_of_tracks(names, len(names)))
    assert layout == adm.ChannelLayout(speakers, effects=effects)
    assert layout.n_channels == len(names)


def test_adm_read_without_track_definitions():
    names = ["AT_00010001_01", "AT_00010029_01"]
    assert adm.read(info_of_tracks(names, 2)) is None


@pytest.mark.parametrize(
    ("mask", "n_channels", "speakers", "effects"),
    [
        (0x3F, 6, FIVE, (3,)),
        (0x60F, 6, FIVE, (3,)),
        (0x603, 4, (*FIVE[:2], *FIVE[3:]), ()),
        (0x70F, 7, (*FIVE[:3], (180.0, 0.0, 1.0), *SEVEN[5:]), (3,)),
        (0x63F, 8, SEVEN, (3,)),
        (0x107, 4, (*FIVE[:3], (180.0, 0.0, 1.0)), ()),
    ],
)
def test_wave_mask_gives_layout(mask, n_channels, speakers, effects):
    layout = adm.read(info_of_tracks([], n_channels, mask=mask))
    assert layout == adm.ChannelLayout(speakers, effects=effects)


@pytest.mark.parametrize(("mask", "n_channels"), [(0, 6), (0x3F, 8), (0x3, 2), (0x80000000, 1)])
def test_wave_mask_with_missing_channels_gives_nothing(mask, n_channels):
    assert adm.read(info_of_tracks([], n_channels, mask=mask)) is None


@pytest.mark.parametrize(
    "mark",
    [
        "<speakerLabel>LFE1</speakerLabel>",
        "<speakerLabel>urn:itu:bs:2051:0:speaker:LFE</speakerLabel>",
        "<speakerLabel>RC_LFE</speakerLabel>",
        "<lowPass/>",
    ],
)
def test_adm_low_frequency_effects_are_apart_from_speakers(mark: str):
    info = written(adm.ChannelLayout(FIVE[:3]))
    text = info.axml.decode()
    if "lowPass" in mark:
        bound = '<frequency typeDefinition="lowPass">120</frequency>'
        block = '<audioBlockFormat audioBlockFormatID="AB_00011002'
        text = text.replace(block, bound + block)
    else:
        text = text.replace("<speakerLabel>2</speakerLabel>", mark)
    layout = adm.read(replace(info, axml=text.encode()))
    assert layout == adm.ChannelLayout((FIVE[0], FIVE[2]), effects=(1,))
