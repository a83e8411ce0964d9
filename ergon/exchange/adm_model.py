"""The elements of an Audio Definition Model and what they refer to (ITU-R BS.2076-2).

IDs are kept in capitals: their digits are hexadecimal, and programs write both cases.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple
from xml.etree import ElementTree

from ergon.common.terminal import printable
from ergon.common.xml_text import XmlError

_OBJECT_DEPTH_MAX = 32
_UNREAD_OF_OBJECTS = ("positionOffset", "audioComplementaryObjectIDRef", "alternativeValueSet")


class Track(NamedTuple):
    """A row of `chna`: the IDs of an audioTrackUID, of what it plays, and of its pack."""

    uid: str
    reference: str
    pack: str


def finite_number(number_text: str | None) -> float:
    """A number of the description. Raises XmlError."""
    try:
        return float(number_text or "")
    except ValueError:
        raise XmlError(f"{(number_text or '')[:40]!r} is not a number") from None


class Model:
    """The elements of a description by their IDs."""

    def __init__(self, root: ElementTree.Element) -> None:
        """`root` may have no elements at all."""
        self.channels = _elements_by_id(root, "audioChannelFormat")
        self._packs = _elements_by_id(root, "audioPackFormat")
        self._uids = _elements_by_id(root, "audioTrackUID", "UID")
        self._objects = _elements_by_id(root, "audioObject")
        track_formats = _elements_by_id(root, "audioTrackFormat")
        streams = _elements_by_id(root, "audioStreamFormat")
        self._channel_by_track: dict[str, str] = {}
        for stream in streams.values():  # either of both may name the other
            for track_id in _references(stream, "audioTrackFormat"):
                self._name_channel(track_id, stream)
        for track_id, track_format in track_formats.items():
            for stream_id in _references(track_format, "audioStreamFormat"):
                if stream_id in streams:
                    self._name_channel(track_id, streams[stream_id])

    def _name_channel(self, track_id: str, stream: ElementTree.Element) -> None:
        for channel_id in _references(stream, "audioChannelFormat"):
            self._channel_by_track[track_id] = channel_id

    def channel_id(self, track: Track) -> str:
        """The ID of the channel that a track plays: by references, or else by the digits of its own
        ID, AT_yyyyxxxx_zz (BS.2076, 6); a file may also name the channel itself.
        """
        reference = track.reference
        if not reference and (uid := self._uids.get(track.uid)) is not None:
            both = (*_references(uid, "audioChannelFormat"), *_references(uid, "audioTrackFormat"))
            reference = next(iter(both), "")
        return self._channel_by_track.get(reference, f"AC_{reference[3:11]}")

    def pack(self, track: Track, channel_id: str) -> ElementTree.Element | None:
        """The pack of a track: that of its row, of its UID, or the one that has its channel."""
        pack_id = track.pack
        if not pack_id and (uid := self._uids.get(track.uid)) is not None:
            pack_id = next(_references(uid, "audioPackFormat"), "")
        if pack_id in self._packs:
            return self._packs[pack_id]
        holders = (
            pack
            for pack in self._packs.values()
            if channel_id in _references(pack, "audioChannelFormat")
        )
        return next(holders, None)

    def gains_and_notes(
        self, tracks: Sequence[Track], definitions: Sequence[ElementTree.Element | None]
    ) -> tuple[tuple[float, ...], tuple[str, ...]]:
        """The factor of each channel, empty where each is 1, and sentences on gains and on what is
        not read. Raises XmlError.
        """
        gains, notes = [], []
        object_gains = self._object_gains()
        for number, (track, definition) in enumerate(zip(tracks, definitions, strict=True), 1):
            factors = [gain for refs, gain in object_gains if {track.uid, track.pack} & refs]
            if len(set(factors)) > 1:
                notes.append(f"channel {number} is in objects of several gains; the first counts")
            gain = factors[0] if factors else 1.0
            blocks = [] if definition is None else definition.findall("audioBlockFormat")
            gain *= _gain(blocks[0]) if blocks else 1.0
            gains.append(gain)
            if len(blocks) > 1:
                notes.append(
                    f"channel {number} moves ({len(blocks)} blocks); only the first counts"
                )
            if gain != 1.0:
                is_muted = "is muted" if gain == 0.0 else f"has the gain {gain:.4g}"
                notes.append(f"channel {number} {is_muted} by its description")
        for name in _UNREAD_OF_OBJECTS:
            if any(element.find(name) is not None for element in self._objects.values()):
                notes.append(f"{name} of its objects is not read")
        return (tuple(gains) if any(gain != 1.0 for gain in gains) else ()), tuple(notes)

    def _object_gains(self) -> list[tuple[set[str], float]]:
        """The IDs of what an object has, and the factor of the object with all that hold it: UIDs,
        or packs of one that names no UIDs.
        """
        children = {
            child
            for element in self._objects.values()
            for child in _references(element, "audioObject")
        }
        pending = [(name, 1.0, 0) for name in self._objects if name not in children]
        gains: list[tuple[set[str], float]] = []
        while pending:
            name, outer_gain, depth = pending.pop(0)
            element = self._objects.get(name)
            if element is None:
                continue
            if depth > _OBJECT_DEPTH_MAX or len(gains) > 10_000:
                raise XmlError("its objects contain themselves, or are too many")
            is_muted = (element.findtext("mute") or "0").strip().lower() in ("1", "true")
            gain = 0.0 if is_muted else outer_gain * _gain(element)
            uids = {*_references(element, "audioTrackUID")}
            gains.append((uids or {*_references(element, "audioPackFormat")}, gain))
            pending += [(child, gain, depth + 1) for child in _references(element, "audioObject")]
        return gains


def _elements_by_id(
    root: ElementTree.Element, tag: str, id_name: str = ""
) -> dict[str, ElementTree.Element]:
    id_name = id_name or f"{tag}ID"
    return {(element.get(id_name) or "").strip().upper(): element for element in root.iter(tag)}


def _references(element: ElementTree.Element, tag: str) -> Iterator[str]:
    """The IDs of elements that an element refers to."""
    references = element.findall(f"{tag}IDRef") + element.findall(f"{tag}Ref")
    return ((reference.text or "").strip().upper() for reference in references)


def _gain(element: ElementTree.Element) -> float:
    """The factor of an object or of a block. Raises XmlError."""
    gain = element.find("gain")
    if gain is None or not (gain.text or "").strip():
        return 1.0
    value = finite_number(gain.text)
    if (gain.get("gainUnit") or "linear").strip().lower() == "db":
        value = 10.0 ** (value / 20.0) if value < 200.0 else math.inf
    if not 0.0 <= value <= 1e6:
        raise XmlError(f"a gain of {printable((gain.text or '')[:20])} is out of range")
    return value
