"""What the channels of a WAVE file are: the Audio Definition Model, in chunks `axml` and `chna`.

This module writes them; `adm_reading` reads them. Sources: ITU-R BS.2076-2 (the model), BS.2088-1
(the chunks). Loudspeakers are DirectSpeakers, whose distances are fractions of the pack's
`absoluteDistance`; Ambisonics is HOA in ACN order and SN3D.
"""

from __future__ import annotations

import struct
from xml.sax.saxutils import quoteattr

from .adm_reading import read as read
from .channel_layout import ChannelLayout as ChannelLayout

_UID_FORMAT = struct.Struct("<H12s14s11sx")
_FIRST_CHANNEL_ID = 0x1001  # first ID of definitions in the file itself
_TYPE_ID_BY_NAME = {"DirectSpeakers": "0001", "HOA": "0004"}


def chunks(layout: ChannelLayout, title: str) -> bytes:
    """The chunks `chna` and `axml`, which precede the samples of a file."""
    return _chunk(b"chna", _chna_content(layout)) + _chunk(
        b"axml", _axml_content(layout, title).encode()
    )


def _chunk(name: bytes, content: bytes) -> bytes:
    return name + struct.pack("<I", len(content)) + content + bytes(len(content) & 1)


def _definition_type(layout: ChannelLayout) -> str:
    return "DirectSpeakers" if layout.order is None else "HOA"


def _channel_ids(layout: ChannelLayout) -> list[str]:
    """`00011001` …, one for each channel."""
    prefix = _TYPE_ID_BY_NAME[_definition_type(layout)]
    return [f"{prefix}{_FIRST_CHANNEL_ID + i:04x}" for i in range(layout.n_channels)]


def _chna_content(layout: ChannelLayout) -> bytes:
    pack = f"AP_{_TYPE_ID_BY_NAME[_definition_type(layout)]}{_FIRST_CHANNEL_ID:04x}".encode()
    ids = _channel_ids(layout)
    chna_rows = [
        _UID_FORMAT.pack(i, f"ATU_{i:08x}".encode(), f"AT_{number}_01".encode(), pack)
        for i, number in enumerate(ids, 1)
    ]
    return struct.pack("<HH", len(ids), len(ids)) + b"".join(chna_rows)


def _axml_content(layout: ChannelLayout, piece_title: str) -> str:
    layout_kind, ids = _definition_type(layout), _channel_ids(layout)
    type_label = _TYPE_ID_BY_NAME[layout_kind]
    pack = f"AP_{type_label}{_FIRST_CHANNEL_ID:04x}"
    quoted_title = quoteattr("".join(c for c in piece_title if c.isprintable()) or "ergon")
    type_attributes = f'typeLabel="{type_label}" typeDefinition="{layout_kind}"'
    distance_max = max((r for *_, r in layout.speakers), default=1.0) or 1.0
    distance_attribute = f' absoluteDistance="{distance_max:.6g}"' if layout.order is None else ""
    elements = [
        f'<audioProgramme audioProgrammeID="APR_1001" audioProgrammeName={quoted_title}>',
        "<audioContentIDRef>ACO_1001</audioContentIDRef></audioProgramme>",
        f'<audioContent audioContentID="ACO_1001" audioContentName={quoted_title}>',
        "<audioObjectIDRef>AO_1001</audioObjectIDRef></audioContent>",
        f'<audioObject audioObjectID="AO_1001" audioObjectName={quoted_title}>',
        f"<audioPackFormatIDRef>{pack}</audioPackFormatIDRef>",
        *(f"<audioTrackUIDRef>ATU_{i:08x}</audioTrackUIDRef>" for i in range(1, len(ids) + 1)),
        "</audioObject>",
        f'<audioPackFormat audioPackFormatID="{pack}" audioPackFormatName={quoted_title} '
        f"{type_attributes}{distance_attribute}>",
        *(f"<audioChannelFormatIDRef>AC_{number}</audioChannelFormatIDRef>" for number in ids),
        "</audioPackFormat>",
    ]
    for i, format_id in enumerate(ids):
        channel_name = f"{i + 1}"
        elements += [
            f'<audioChannelFormat audioChannelFormatID="AC_{format_id}" '
            f'audioChannelFormatName="{channel_name}" {type_attributes}>'
            f'<audioBlockFormat audioBlockFormatID="AB_{format_id}_00000001">',
            *_block_format(layout, i, distance_max),
            "</audioBlockFormat></audioChannelFormat>",
            f'<audioStreamFormat audioStreamFormatID="AS_{format_id}" '
            f'audioStreamFormatName="{channel_name}" '
            'formatLabel="0001" formatDefinition="PCM">'
            f"<audioChannelFormatIDRef>AC_{format_id}</audioChannelFormatIDRef>"
            f"<audioTrackFormatIDRef>AT_{format_id}_01</audioTrackFormatIDRef></audioStreamFormat>",
            f'<audioTrackFormat audioTrackFormatID="AT_{format_id}_01" '
            f'audioTrackFormatName="{channel_name}" '
            'formatLabel="0001" formatDefinition="PCM">'
            f"<audioStreamFormatIDRef>AS_{format_id}</audioStreamFormatIDRef></audioTrackFormat>",
            f'<audioTrackUID UID="ATU_{i + 1:08x}">'
            f"<audioTrackFormatIDRef>AT_{format_id}_01</audioTrackFormatIDRef>"
            f"<audioPackFormatIDRef>{pack}</audioPackFormatIDRef></audioTrackUID>",
        ]
    body = "\n".join(elements)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<ebuCoreMain xmlns="urn:ebu:metadata-schema:ebuCore_2014"><coreMetadata><format>'
        f"<audioFormatExtended>\n{body}\n</audioFormatExtended></format></coreMetadata>"
        "</ebuCoreMain>\n"
    )


def _block_format(layout: ChannelLayout, speaker_index: int, distance_max: float) -> list[str]:
    if layout.order is not None:
        n = next(n for n in range(speaker_index + 1) if speaker_index < (n + 1) ** 2)
        degree = speaker_index - n * n - n
        return [
            f"<order>{n}</order><degree>{degree}</degree>",
            "<normalization>SN3D</normalization>",
        ]
    azimuth, elevation, distance = layout.speakers[speaker_index]
    return [
        f"<speakerLabel>{speaker_index + 1}</speakerLabel>",
        f'<position coordinate="azimuth">{azimuth:.6f}</position>',
        f'<position coordinate="elevation">{elevation:.6f}</position>',
        f'<position coordinate="distance">{distance / distance_max:.6f}</position>',
    ]
