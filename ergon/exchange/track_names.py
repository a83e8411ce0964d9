"""Names of the channels of a WAVE file, as workstations read them: the chunk `iXML`.

Source: iXML specification 3.01 (TRACK_LIST: CHANNEL_INDEX, INTERLEAVE_INDEX, NAME).
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


def ixml_content(channel_names: Sequence[str], piece_title: str) -> bytes:
    """The content of an `iXML` chunk: the title of the piece, and a name for each channel."""
    tracks = "".join(
        f"<TRACK><CHANNEL_INDEX>{number}</CHANNEL_INDEX>"
        f"<INTERLEAVE_INDEX>{number}</INTERLEAVE_INDEX><NAME>{_escaped_text(name)}</NAME></TRACK>"
        for number, name in enumerate(channel_names, 1)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<BWFXML><IXML_VERSION>3.01</IXML_VERSION>'
        f"<PROJECT>{_escaped_text(piece_title)}</PROJECT><TRACK_LIST>"
        f"<TRACK_COUNT>{len(channel_names)}</TRACK_COUNT>{tracks}</TRACK_LIST></BWFXML>\n"
    ).encode()


def track_names(ixml_content: bytes, n_channels: int) -> tuple[str, ...]:
    """The names that an `iXML` chunk gives to the channels, "" where it has none; nothing where no
    channel has one, or where the chunk cannot be read.
    """
    from ergon.common.xml_text import XmlError, parse_xml

    try:
        root = parse_xml(ixml_content.rstrip(b"\0"))
    except XmlError:
        return ()
    channel_names = [""] * n_channels
    for track in root.iter("TRACK"):
        index = (track.findtext("INTERLEAVE_INDEX") or "").strip()
        number = int(index) if index.isascii() and index.isdecimal() and len(index) < 6 else 0
        if 1 <= number <= n_channels:
            channel_names[number - 1] = (track.findtext("NAME") or "").strip()
    return tuple(channel_names) if any(channel_names) else ()


def _escaped_text(text: str) -> str:
    return escape("".join(c for c in text if c.isprintable()), quote=False)
