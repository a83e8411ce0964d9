"""Names of channels in WAVE files: the chunk `iXML`, beside an XML reader of its own."""

import io
import struct
from xml.etree import ElementTree

import pytest

from ergon.exchange.track_names import ixml_content, track_names
from ergon.exchange.wave_header import Stamp, WaveFormat, pack, parse

FORMAT = WaveFormat(48_000, 2, 24)


def test_ixml_in_wave_header():
    head = pack(FORMAT, 0, Stamp("A & B", tracks=("low <1>", "höchst 2")))
    start = head.index(b"iXML")
    size = struct.unpack_from("<I", head, start + 4)[0]
    root = ElementTree.fromstring(head[start + 8 : start + 8 + size])
    assert root.findtext("PROJECT") == "A & B"
    assert root.findtext("TRACK_LIST/TRACK_COUNT") == "2"
    rows = [(t.findtext("INTERLEAVE_INDEX"), t.findtext("NAME")) for t in root.iter("TRACK")]
    assert rows == [("1", "low <1>"), ("2", "höchst 2")]
    info = parse(io.BytesIO(head))
    assert (info.tracks, info.unread_chunks) == (("low <1>", "höchst 2"), ())


def test_wave_header_without_track_names():
    head = pack(FORMAT, 0, Stamp("A"))
    assert b"iXML" not in head
    assert parse(io.BytesIO(head)).tracks == ()


@pytest.mark.parametrize(
    ("content", "names"),
    [
        (ixml_content(["low"], "x"), ("low", "")),
        (ixml_content(["low", "high", "third"], "x"), ("low", "high")),
        (ixml_content(["low\n\x07", "high"], "\x00"), ("low", "high")),
        (
            b"<BWFXML><TRACK><INTERLEAVE_INDEX>-1</INTERLEAVE_INDEX><NAME>a</NAME></TRACK></BWFXML>",
            (),
        ),
        (b"<BWFXML><TRACK>", ()),
        (b"", ()),
        (b'<!DOCTYPE a [<!ENTITY b "c">]><BWFXML/>', ()),
    ],
)
def test_track_names_of_content(content, names):
    assert track_names(content, 2) == names
