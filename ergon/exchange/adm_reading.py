"""Reads what the channels of a WAVE file are: the chunks `axml` and `chna`, or the channel mask.

Sources: ITU-R BS.2076-2 (the model), BS.2088-1 (the chunks), EBU Tech 3388 (the EBU's renderer):
references lead from a track to its channel, IDs compare without case, gains of objects within
objects and of blocks multiply.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from ergon.common.xml_text import XmlError, parse_xml

from .adm_model import Model, Track, finite_number
from .channel_layout import ChannelLayout
from .speaker_labels import common_label, is_low_frequency_effects, labels_of_mask, place_of

if TYPE_CHECKING:
    from ergon.space.directions import Angles

    from .wave_header import WaveInfo

_UID_FORMAT = struct.Struct("<H12s14s11sx")
_CHANNELS_MAX = 1024  # channels
_EFFECTS_HZ = 200.0  # highest frequency of a channel for effects (BS.2051: 120 Hz)
_DISTANCE_METRES_MAX = 1e4  # [m]


@dataclass(frozen=True, slots=True)
class _Channel:
    """A channel of a file: its definition, or the label of a common one, and its pack."""

    definition: ElementTree.Element | str
    pack: ElementTree.Element | None


def read(info: WaveInfo) -> ChannelLayout | None:
    """What a file says its channels are; None without a description, or for one not supported here.

    Raises XmlError for a description that cannot be read.
    """
    if not info.chna:
        return _speakers_of_mask(info)
    tracks = _tracks(info.chna, info.format.n_channels)
    model = Model(parse_xml(info.axml) if info.axml else ElementTree.Element("none"))
    channels = []
    for track in tracks:
        format_id = model.channel_id(track)
        definition = model.channels.get(format_id) or common_label(format_id)
        if definition is None:
            return None
        channels.append(_Channel(definition, model.pack(track, format_id)))
    definitions = [
        channel.definition for channel in channels if not isinstance(channel.definition, str)
    ]
    kinds = {
        definition.get("typeDefinition") or definition.get("typeLabel")
        for definition in definitions
    }
    layout = None
    if channels and len(definitions) == len(channels) and kinds <= {"HOA", "0004"}:
        layout = _ambisonics_of_channels(channels)
    elif channels and (kinds <= {"DirectSpeakers", "0001"} or len(definitions) < len(channels)):
        layout = _speakers_of_channels(channels)
    if layout is None:
        return None
    gains, notes = model.gains_and_notes(
        tracks,
        [
            None if isinstance(channel.definition, str) else channel.definition
            for channel in channels
        ],
    )
    return replace(layout, gains=gains, notes=notes)


def _tracks(file_bytes: bytes, n_channels: int) -> list[Track]:
    """What each channel plays, the first of several; empty if the rows do not name exactly the
    channels of the file.
    """
    tracks: dict[int, Track] = {}
    for offset in range(4, len(file_bytes) - _UID_FORMAT.size + 1, _UID_FORMAT.size):
        index, *fields = _UID_FORMAT.unpack_from(file_bytes, offset)
        if index:
            ids = (field.rstrip(b"\0").decode("ascii", "replace") for field in fields)
            tracks.setdefault(index, Track(*(text.strip().upper() for text in ids)))
    track_numbers = range(1, min(n_channels, _CHANNELS_MAX) + 1)
    return [tracks[i] for i in track_numbers] if set(tracks) == set(track_numbers) else []


def _ambisonics_of_channels(channels: Sequence[_Channel]) -> ChannelLayout | None:
    acn_numbers = []
    for channel in channels:
        assert not isinstance(channel.definition, str)
        block_format = channel.definition.find("audioBlockFormat")
        if block_format is None:
            return None
        holders = [block_format] if channel.pack is None else [block_format, channel.pack]
        normalizations = [holder.findtext("normalization") for holder in holders]
        normalization = next((text.strip() for text in normalizations if text), "SN3D")
        if normalization.upper() != "SN3D":
            raise XmlError(
                f"its Ambisonics is normalised as {normalization[:20]}, and SN3D is read; convert "
                "it to SN3D"
            )
        n, m = (
            finite_number(block_format.findtext("order")),
            finite_number(block_format.findtext("degree")),
        )
        acn_numbers.append(n * n + n + m)
    field_order = next((n for n in range(8) if (n + 1) ** 2 == len(acn_numbers)), None)
    return (
        ChannelLayout(order=field_order)
        if field_order is not None and acn_numbers == [*range(len(acn_numbers))]
        else None
    )


def _speakers_of_channels(channels: Sequence[_Channel]) -> ChannelLayout | None:
    """The loudspeakers of definitions in the file, or of labels of common ones."""
    speakers: list[Angles] = []
    effects_channels = []
    for number, channel in enumerate(channels):
        definition, pack = channel.definition, channel.pack
        radius_text = None if pack is None else pack.get("absoluteDistance")
        radius = finite_number(radius_text) if radius_text else 1.0
        if isinstance(definition, str) or _is_effects(definition):
            common_direction = place_of(definition) if isinstance(definition, str) else None
            if common_direction is None:
                effects_channels.append(number)
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
        distance = finite_number(coordinates.get("distance") or "1") * radius
        azimuth, elevation = (
            finite_number(coordinates["azimuth"]),
            finite_number(coordinates["elevation"]),
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
    bounds = (
        frequency.text for frequency in frequencies if frequency.get("typeDefinition") == "lowPass"
    )
    labels = [
        label.text or "" for label in channel_element.findall("audioBlockFormat/speakerLabel")
    ]
    return any(map(is_low_frequency_effects, labels)) or any(
        finite_number(hz) <= _EFFECTS_HZ for hz in bounds
    )


def _speakers_of_mask(info: WaveInfo) -> ChannelLayout | None:
    """The channels that the mask of the format names. Two are not read so: nearly every program
    writes that mask, whatever the channels are.
    """
    labels = labels_of_mask(info.speaker_mask)
    if len(labels) != info.format.n_channels or len(labels) < 3:
        return None
    return _speakers_of_channels([_Channel(label, None) for label in labels])
