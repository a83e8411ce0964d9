"""What the channels of a WAVE file are: the Audio Definition Model, in chunks `axml` and `chna`.

Sources: ITU-R BS.2076-2 (the model), BS.2088-1 (the chunks). Loudspeakers are DirectSpeakers,
whose distances are fractions of the pack's `absoluteDistance`; Ambisonics is HOA in ACN order
and SN3D.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from ergon.common.xml_text import XmlError, parse_xml

from .speaker_labels import common_label, is_effects, masked_labels, place_of

if TYPE_CHECKING:
    from ergon.space.directions import Angles

    from .wave_header import WaveInfo

_UID_FORMAT = struct.Struct("<H12s14s11sx")
_FIRST_CHANNEL_ID = 0x1001  # first ID of definitions in the file itself
_TYPE_ID_BY_NAME = {"DirectSpeakers": "0001", "HOA": "0004"}
_CHANNELS_MAX = 1024  # channels
_EFFECTS_HZ = 200.0  # highest frequency of a channel for effects (BS.2051: 120 Hz)
_DISTANCE_METRES_MAX = 1e4  # [m]


@dataclass(frozen=True, slots=True)
class ChannelLayout:
    """What the channels of a file are: loudspeakers, or Ambisonics of an order (ACN, SN3D)."""

    speakers: tuple[Angles, ...] = ()
    order: int | None = None
    effects: tuple[int, ...] = ()  # channels from 0 for low-frequency effects, no loudspeakers

    @property
    def n_channels(self) -> int:
        """Number of these channels."""
        if self.order is not None:
            return (self.order + 1) ** 2
        return len(self.speakers) + len(self.effects)


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
        order = next(
            order for order in range(speaker_index + 1) if speaker_index < (order + 1) ** 2
        )
        degree = speaker_index - order * order - order
        return [
            f"<order>{order}</order><degree>{degree}</degree>",
            "<normalization>SN3D</normalization>",
        ]
    azimuth, elevation, distance = layout.speakers[speaker_index]
    return [
        f"<speakerLabel>{speaker_index + 1}</speakerLabel>",
        f'<position coordinate="azimuth">{azimuth:.6f}</position>',
        f'<position coordinate="elevation">{elevation:.6f}</position>',
        f'<position coordinate="distance">{distance / distance_max:.6f}</position>',
    ]


def read(info: WaveInfo) -> ChannelLayout | None:
    """What a file says its channels are; None without a description, or for one not supported here.

    Raises XmlError for a description that cannot be read.
    """
    if not info.chna:
        return _speakers_of_mask(info)
    tracks = _track_formats(info.chna, info.format.n_channels)
    root = parse_xml(info.axml) if info.axml else ElementTree.Element("none")
    format_by_id = {
        channel_format.get("audioChannelFormatID"): channel_format
        for channel_format in root.iter("audioChannelFormat")
    }
    # AT_yyyyxxxx_zz is the track of AC_yyyyxxxx (BS.2076, 6); a file may also name the AC directly.
    format_ids = [f"AC_{track[3:11]}" for track in tracks]
    channel_formats = [format_by_id[name] for name in format_ids if name in format_by_id]
    label_by_channel = {
        i: common_label(n) for i, n in enumerate(format_ids) if n not in format_by_id
    }
    if not format_ids or None in label_by_channel.values():
        return None
    if label_by_channel:
        channel_elements = iter(channel_formats)
        return _speakers_of_channels(
            [label_by_channel.get(i) or next(channel_elements) for i in range(len(format_ids))],
            root,
        )
    channel_kinds = {
        channel_format.get("typeDefinition") or channel_format.get("typeLabel")
        for channel_format in channel_formats
    }
    if channel_kinds <= {"HOA", "0004"}:
        return _ambisonics_of_channels(channel_formats)
    if channel_kinds <= {"DirectSpeakers", "0001"}:
        return _speakers_of_channels(channel_formats, root)
    return None


def _track_formats(file_bytes: bytes, n_channels: int) -> list[str]:
    """The format that each channel plays (AT_… or AC_…), the first of several; empty if the rows do
    not name exactly the channels of the file.
    """
    format_by_channel: dict[int, str] = {}
    for row_start in range(4, len(file_bytes) - _UID_FORMAT.size + 1, _UID_FORMAT.size):
        index, _, format_id, _ = _UID_FORMAT.unpack_from(file_bytes, row_start)
        if index:
            format_by_channel.setdefault(index, format_id.rstrip(b"\0").decode("ascii", "replace"))
    track_numbers = range(1, min(n_channels, _CHANNELS_MAX) + 1)
    return (
        [format_by_channel[i] for i in track_numbers]
        if set(format_by_channel) == set(track_numbers)
        else []
    )


def _ambisonics_of_channels(channels: Sequence[ElementTree.Element]) -> ChannelLayout | None:
    acn_numbers = []
    for channel in channels:
        block_format = channel.find("audioBlockFormat")
        if (
            block_format is None
            or (block_format.findtext("normalization") or "SN3D").strip() != "SN3D"
        ):
            return None
        order, degree = (
            _finite_number(block_format.findtext("order")),
            _finite_number(block_format.findtext("degree")),
        )
        acn_numbers.append(order * order + order + degree)
    layout_order = next((order for order in range(8) if (order + 1) ** 2 == len(acn_numbers)), None)
    return (
        ChannelLayout(order=layout_order)
        if layout_order is not None and acn_numbers == [*range(len(acn_numbers))]
        else None
    )


def _speakers_of_channels(
    channels: Sequence[ElementTree.Element | str], root: ElementTree.Element
) -> ChannelLayout | None:
    """The loudspeakers of definitions in the file, or of labels of common ones."""
    distance_texts = (pack.get("absoluteDistance") for pack in root.iter("audioPackFormat"))
    radius = next((_finite_number(text) for text in distance_texts if text), 1.0)
    speakers: list[Angles] = []
    effects_channels = []
    for channel, definition in enumerate(channels):
        if isinstance(definition, str) or _is_effects(definition):
            common_direction = place_of(definition) if isinstance(definition, str) else None
            if common_direction is None:
                effects_channels.append(channel)
            else:
                speakers.append((*common_direction[:2], radius))
            continue
        block_format = definition.find("audioBlockFormat")
        if block_format is None:
            return None
        coordinates = {
            p.get("coordinate"): p.text
            for p in block_format.findall("position")
            if not p.get("bound")
        }
        if not {"azimuth", "elevation"} <= coordinates.keys():
            return None
        distance = _finite_number(coordinates.get("distance") or "1") * radius
        azimuth, elevation = (
            _finite_number(coordinates["azimuth"]),
            _finite_number(coordinates["elevation"]),
        )
        if not (
            abs(azimuth) <= 360.0
            and abs(elevation) <= 90.0
            and 0.0 <= distance <= _DISTANCE_METRES_MAX
        ):
            raise XmlError("a loudspeaker lies out of range")
        speakers.append((azimuth, elevation, distance))
    return ChannelLayout(tuple(speakers), effects=tuple(effects_channels))


def _is_effects(channel_element: ElementTree.Element) -> bool:
    """Whether a channel is for low-frequency effects: by its labels, or by its lowpass."""
    frequencies = channel_element.findall("frequency")
    lowpass_texts = (
        frequency.text for frequency in frequencies if frequency.get("typeDefinition") == "lowPass"
    )
    labels = [
        label.text or "" for label in channel_element.findall("audioBlockFormat/speakerLabel")
    ]
    return any(map(is_effects, labels)) or any(
        _finite_number(hz) <= _EFFECTS_HZ for hz in lowpass_texts
    )


def _speakers_of_mask(info: WaveInfo) -> ChannelLayout | None:
    """The channels that the mask of the format names. Two are not read so: nearly every program
    writes that mask, whatever the channels are.
    """
    labels = masked_labels(info.speaker_mask)
    if len(labels) != info.format.n_channels or len(labels) < 3:
        return None
    return _speakers_of_channels(labels, ElementTree.Element("none"))


def _finite_number(number_text: str | None) -> float:
    try:
        return float(number_text or "")
    except ValueError:
        raise XmlError(f"{(number_text or '')[:40]!r} is not a number") from None
