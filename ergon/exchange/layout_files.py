"""Files of loudspeaker layouts of other programs.

IEM AllRADecoder (JSON), the EBU ADM renderer (YAML), SpatGRIS 3 (XML speaker setup). A layout
here is a list of angles and distances; only what all formats share is kept: where each
loudspeaker is, and its output.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from ergon.common.errors import ErgonError
from ergon.common.structured import MalformedTextError, parse_json
from ergon.common.terminal import printable
from ergon.common.xml_text import XmlError, parse_xml
from ergon.common.yaml_text import YamlError, parse_yaml
from ergon.space.directions import Angles, angles, point, unit_vectors

from .speaker_labels import is_low_frequency_effects

FILE_BYTES_MAX = 4 << 20  # bytes of a file
SPEAKERS_MAX = 1024
_DISTANCE_MAX = 100.0  # [m]
_DISTANCE_MIN = 0.01
_OUTPUT_MAX = 65_536
_YAML_MAX = 64 * SPEAKERS_MAX  # events of a file of YAML, whose reader takes 30 µs for each


class LayoutFileError(ErgonError, ValueError):
    """The file is not a layout that can be read here."""


@dataclass(frozen=True, slots=True)
class ReadLayout:
    """The loudspeakers of a room in the order of their outputs, the number of each output from 1,
    and sentences on what was left out.
    """

    speakers: list[Angles]
    outputs: list[int]
    left_out: list[str]

    def notes(self) -> list[str]:
        """Sentences on what was left out, and on outputs with gaps between them."""
        if self.outputs == [*range(1, len(self.outputs) + 1)]:
            return self.left_out
        stated_outputs = ", ".join(map(str, self.outputs))
        return [*self.left_out, f"its loudspeakers keep their outputs: {stated_outputs}"]


@dataclass(frozen=True, slots=True)
class Form:
    """One program's files: their ending, how they are written, how they are read."""

    name: str
    ending: str
    write: Callable[[Sequence[Angles], Sequence[int], str], str]
    read: Callable[[bytes], ReadLayout]


# --- IEM ----------------------------------------------------------------------------------------


def _write_iem(speakers: Sequence[Angles], output_numbers: Sequence[int], piece_title: str) -> str:
    """An IEM layout, with the silent imaginary loudspeakers that close the hull."""
    from ergon.space.panning import imaginary_speakers

    speaker_rows = [
        {
            "Azimuth": _rounded_number(azimuth),
            "Elevation": _rounded_number(elevation),
            "Radius": _rounded_number(distance),
            "IsImaginary": False,
            "Channel": number,
            "Gain": 1.0,
        }
        for number, (azimuth, elevation, distance) in zip(output_numbers, speakers, strict=True)
    ]
    array = unit_vectors(point(azimuth, elevation, 1.0) for azimuth, elevation, _ in speakers)
    for place in imaginary_speakers(array).tolist():
        _, elevation, _ = angles(tuple(place))
        speaker_rows.append(
            {
                "Azimuth": 0.0,
                "Elevation": elevation,
                "Radius": 1.0,
                "IsImaginary": True,
                "Channel": -1,
                "Gain": 0.0,
            }
        )
    document = {
        "Name": piece_title,
        "Description": "made by ergon",
        "LoudspeakerLayout": {"Name": piece_title, "Loudspeakers": speaker_rows},
    }
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _read_iem(data: bytes) -> ReadLayout:
    try:
        document = parse_json(data)
    except MalformedTextError as error:
        raise LayoutFileError(str(error)) from None
    layout = document.get("LoudspeakerLayout") if isinstance(document, dict) else None
    speaker_rows = layout.get("Loudspeakers") if isinstance(layout, dict) else None
    if not isinstance(speaker_rows, list) or not all(isinstance(row, dict) for row in speaker_rows):
        raise LayoutFileError("it has no list `LoudspeakerLayout: Loudspeakers`")
    real_rows = [row for row in speaker_rows if not _is_true(row.get("IsImaginary"))]
    numbered_speakers: list[tuple[float, Angles]] = []
    left_out: list[str] = []
    if n_imaginary := len(speaker_rows) - len(real_rows):
        speakers_are = "loudspeaker is" if n_imaginary == 1 else "loudspeakers are"
        left_out.append(f"{n_imaginary:,} imaginary {speakers_are} left out")
    for i, speaker_row in enumerate(real_rows, 1):
        if missing := [name for name in ("Azimuth", "Elevation") if name not in speaker_row]:
            raise LayoutFileError(f"loudspeaker {i} has no {missing[0]}")
        channel = _finite_number(speaker_row.get("Channel", i), "Channel")
        speaker_angles = _checked_angles(
            speaker_row.get("Azimuth"), speaker_row.get("Elevation"), speaker_row.get("Radius", 1.0)
        )
        numbered_speakers.append((channel, speaker_angles))
        if _finite_number(speaker_row.get("Gain", 1.0), "Gain") != 1.0:
            left_out.append(_dropped_note("gain", channel))
        left_out += _unread_notes(speaker_row, _IEM_FIELDS, channel)
    return _ordered_speakers(numbered_speakers, left_out)


_IEM_FIELDS = ("Azimuth", "Elevation", "Radius", "IsImaginary", "Channel", "Gain")


def _is_true(value: Any) -> bool:
    """Whether a switch is on, also one that is a text or a number."""
    return str(value).strip().lower() not in ("none", "false", "0", "0.0", "no", "")


# --- EBU ADM renderer ---------------------------------------------------------------------------


def _write_ear(speakers: Sequence[Angles], outputs: Sequence[int], title: str) -> str:
    yaml_lines = [f"# made by ergon: {printable(title)}\n", "speakers:\n"]
    for number, (azimuth, elevation, distance) in zip(outputs, speakers, strict=True):
        azimuth_text, elevation_text, distance_text = map(
            _rounded_number, (azimuth, elevation, distance)
        )
        position = f"{{az: {azimuth_text}, el: {elevation_text}, r: {distance_text}}}"
        yaml_lines.append(
            f"  - {{channel: {number - 1}, names: L{number}, position: {position}}}\n"
        )
    return "".join(yaml_lines)


def _read_ear(data: bytes) -> ReadLayout:
    try:
        document = parse_yaml(data, _YAML_MAX)
    except YamlError as error:
        raise LayoutFileError(str(error)) from None
    speaker_rows = document.get("speakers") if isinstance(document, dict) else document
    if not isinstance(speaker_rows, list) or not all(isinstance(row, dict) for row in speaker_rows):
        raise LayoutFileError("it has no list `speakers`")
    numbered_speakers, left_out = [], []
    for i, speaker_row in enumerate(speaker_rows):
        channel_number = _finite_number(speaker_row.get("channel", i), "channel")
        names = _speaker_names(speaker_row)
        if any(map(is_low_frequency_effects, names)) or _is_true(speaker_row.get("is_lfe")):
            label = printable("/".join(names)[:40])
            left_out.append(
                f"output {channel_number + 1:g} ({label}) is for low-frequency effects, no "
                "loudspeaker of the room: it is left out"
            )
            continue
        speaker_place = speaker_row.get("position")
        if not isinstance(speaker_place, dict):
            raise LayoutFileError(f"loudspeaker {i + 1} has no position")
        if "az" not in speaker_place:
            written_fields = ", ".join(map(str, speaker_place))[:40]
            raise LayoutFileError(
                f"loudspeaker {i + 1} has no azimuth: its position is {printable(written_fields)}; "
                "write `position: {az: 30, el: 0, r: 1}`"
            )
        speaker_angles = _checked_angles(
            speaker_place.get("az"), speaker_place.get("el", 0.0), speaker_place.get("r", 1.0)
        )
        numbered_speakers.append((channel_number, speaker_angles))
        if _finite_number(speaker_row.get("gain_linear", 1.0), "gain") != 1.0:
            left_out.append(_dropped_note("gain", channel_number + 1))
        left_out += _unread_notes(speaker_row, _EAR_FIELDS, channel_number + 1)
        left_out += _unread_notes(speaker_place, ("az", "el", "r"), channel_number + 1)
    return _ordered_speakers(numbered_speakers, left_out, 0)


_EAR_FIELDS = ("channel", "names", "position", "gain_linear", "is_lfe")


def _speaker_names(row: dict[str, Any]) -> list[str]:
    """The names of a loudspeaker: one text, or several in a list."""
    names = row.get("names", ())
    return [str(name) for name in (names if isinstance(names, list) else [names])]


# --- SpatGRIS -----------------------------------------------------------------------------------

_SPATGRIS_ROOT, _SPATGRIS_PLACE = "SPEAKER_SETUP", "CARTESIAN_POSITION"
_SPATGRIS_2_ROOT = "SpeakerSetup"
_SPATGRIS_FIELDS = (
    "SPEAKER_PATCH_ID",
    "DIRECT_OUT_ONLY",
    "STATE",
    "IO_STATE",
    "GAIN",
    _SPATGRIS_PLACE,
)
_SPATGRIS_DISPLAY_FIELDS = ("UUID", "SPEAKER_GROUP_NAME", "COLOUR", "COLOR")


def _write_spatgris(speakers: Sequence[Angles], output_numbers: Sequence[int], title: str) -> str:
    """Cartesian: x to the right, y to the front; the farthest loudspeaker of a dome is 1 away."""
    distance_max = max((distance for *_, distance in speakers), default=1.0) or 1.0
    text_lines = [
        '<?xml version="1.0" encoding="UTF-8"?>\n<!-- made by ergon -->\n',
        f'<{_SPATGRIS_ROOT} VERSION="3.1.0" SPAT_MODE="Dome" DIFFUSION="0" GENERAL_MUTE="0">\n',
    ]
    for output_number, (azimuth, elevation, distance) in zip(output_numbers, speakers, strict=True):
        x, y, z = point(azimuth, elevation, distance / distance_max)
        text_lines.append(
            f'  <SPEAKER_{output_number} STATE="normal" GAIN="0" DIRECT_OUT_ONLY="0">\n'
            f'    <POSITION X="{_rounded_number(x)}" Y="{_rounded_number(y)}" '
            f'Z="{_rounded_number(z)}"/>\n'
            f"  </SPEAKER_{output_number}>\n"
        )
    return "".join([*text_lines, f"</{_SPATGRIS_ROOT}>\n"])


def _read_spatgris(xml_bytes: bytes) -> ReadLayout:
    """SPEAKER_n with a POSITION inside, as up to version 3, or SPEAKER in groups, as version 4."""
    try:
        root_element = parse_xml(xml_bytes)
    except XmlError as error:
        raise LayoutFileError(str(error)) from None
    if root_element.tag == _SPATGRIS_2_ROOT:
        raise LayoutFileError(
            "it is a setup of SpatGRIS 2; open it in SpatGRIS 3 or later and save it from there"
        )
    if root_element.tag != _SPATGRIS_ROOT:
        raise LayoutFileError(
            f"its root is {printable(root_element.tag[:40])}, not {_SPATGRIS_ROOT}"
        )
    for group in root_element.iter("SPEAKER_GROUP"):
        rotations = [group.get(name, "0") for name in ("YAW", "PITCH", "ROLL")]
        group_transform = [*rotations, *_split_coordinates(group.get(_SPATGRIS_PLACE, "0, 0, 0"))]
        if any(_finite_number(element, "place of a group") for element in group_transform):
            raise LayoutFileError("a group of its loudspeakers is moved or turned; none may be")
    numbered_speakers, left_out = [], []
    for element in root_element.iter():
        number_element = (
            element.get("SPEAKER_PATCH_ID", "") if element.tag == "SPEAKER" else element.tag[8:]
        )
        is_speaker = element.tag == "SPEAKER" or (
            element.tag.startswith("SPEAKER_") and number_element.isdecimal()
        )
        if not is_speaker:
            continue
        if _is_true(element.get("DIRECT_OUT_ONLY")):
            label = printable(number_element[:20])
            left_out.append(
                f"output {label} is a direct out, no loudspeaker of the room: it is left out"
            )
            continue
        position_element = element.find("POSITION")
        coordinate_texts = (
            _split_coordinates(element.get(_SPATGRIS_PLACE, ""))
            if position_element is None
            else [position_element.get(a) for a in "XYZ"]
        )
        if len(coordinate_texts) != 3:
            raise LayoutFileError(f"loudspeaker {printable(number_element[:20])} has no position")
        x, y, z = (_finite_number(axis, "position") for axis in coordinate_texts)
        output_number = _finite_number(number_element, "number of an output")
        numbered_speakers.append((output_number, _checked_angles(*angles((x, y, z)))))
        if _finite_number(element.get("GAIN", 0.0), "gain"):
            left_out.append(_dropped_note("gain", output_number))
        if element.find("HIGHPASS") is not None:
            left_out.append(_dropped_note("high-pass filter", output_number))
        left_out += _unread_notes(
            element.keys(), (*_SPATGRIS_FIELDS, *_SPATGRIS_DISPLAY_FIELDS), output_number
        )
        left_out += _unread_notes(
            (child.tag for child in element), ("POSITION", "HIGHPASS"), output_number
        )
        state_text = element.get("IO_STATE", element.get("STATE", "normal"))
        if state_text != "normal":
            left_out.append(
                f"output {output_number:g} is {printable(state_text[:20])} there; it sounds here"
            )
    return _ordered_speakers(numbered_speakers, left_out)


def _split_coordinates(text: str) -> list[str]:
    """The parts of a place: `x, y, z`, in parentheses since version 4.0 of setups."""
    return text.strip().removeprefix("(").removesuffix(")").split(",")


# --- what they have in common -------------------------------------------------------------------


def _ordered_speakers(
    numbered_speakers: list[tuple[float, Angles]],
    left_out: Sequence[str] = (),
    first_channel: int = 1,
) -> ReadLayout:
    """Loudspeakers with their outputs, which count from `first_channel`. Raises LayoutFileError."""
    if not 1 <= len(numbered_speakers) <= SPEAKERS_MAX:
        raise LayoutFileError(
            f"it has {len(numbered_speakers):,} loudspeakers; 1 to {SPEAKERS_MAX:,} are read"
        )
    speaker_numbers = [number for number, _ in numbered_speakers]
    counts = Counter(speaker_numbers)
    if repeated := [number for number, count in counts.items() if count > 1]:
        raise LayoutFileError(
            f"{counts[repeated[0]]} of its loudspeakers have the channel {repeated[0]:.10g}; give "
            "each one of its own"
        )
    if not all(number.is_integer() for number in speaker_numbers):
        raise LayoutFileError("the number of an output is not whole")
    if not all(first_channel <= number <= _OUTPUT_MAX for number in speaker_numbers):
        raise LayoutFileError(
            f"outputs are counted from {first_channel} to {_OUTPUT_MAX:,}, here from "
            f"{min(speaker_numbers):.10g} to {max(speaker_numbers):.10g}"
        )
    ordered_speakers = sorted(numbered_speakers, key=lambda pair: pair[0])
    outputs = [int(number) + 1 - first_channel for number, _ in ordered_speakers]
    return ReadLayout(
        [speaker_angles for _, speaker_angles in ordered_speakers], outputs, list(left_out)
    )


def _dropped_note(noun: str, output: float) -> str:
    return f"the {noun} of output {output:g} is not kept"


def _unread_notes(fields: Iterable[str], known_names: Container[str], output: float) -> list[str]:
    """A sentence for each field of a loudspeaker that is not read."""
    return [
        _dropped_note(printable(str(field)[:40]), output)
        for field in fields
        if field not in known_names
    ]


def _checked_angles(azimuth: Any, elevation: Any, distance: Any) -> Angles:
    angles = (
        _finite_number(azimuth, "azimuth"),
        _finite_number(elevation, "elevation"),
        _finite_number(distance, "radius"),
    )
    if not (abs(angles[0]) <= 360.0 and abs(angles[1]) <= 90.0):
        raise LayoutFileError(f"a loudspeaker lies at {angles[0]:g}°, {angles[1]:g}°")
    if not _DISTANCE_MIN <= angles[2] <= _DISTANCE_MAX:
        raise LayoutFileError(f"a loudspeaker is {angles[2]:g} m away")
    return angles


def _finite_number(json_value: Any, noun: str) -> float:
    try:
        if isinstance(json_value, bool) or json_value is None or "_" in str(json_value):
            raise ValueError
        finite_number = float(json_value)
        if abs(finite_number) > 1e9 or finite_number != finite_number:
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise LayoutFileError(
            f"{printable(str(json_value)[:40])!r} is not a valid {noun}"
        ) from None
    return finite_number


def _rounded_number(value: float) -> float:
    return round(value, 9) + 0.0


FORMS = {
    form.name: form
    for form in (
        Form("iem", ".json", _write_iem, _read_iem),
        Form("ear", ".yaml", _write_ear, _read_ear),
        Form("spatgris", ".xml", _write_spatgris, _read_spatgris),
    )
}


def as_yaml(
    speakers: Sequence[Angles],
    piece_title: str,
    radius: float | None = None,
    output_numbers: Sequence[int] = (),
) -> str:
    """A layout of ergon (YAML) for `layout:` of a score; the farthest loudspeaker is `radius` [m]
    away. `output_numbers` are written where they do not follow one another.
    """
    distance_max = max(distance for *_, distance in speakers)
    distance_factor = 1.0 if radius is None or not distance_max else radius / distance_max
    yaml_lines = [
        "ergon: 1 # made by ergon\n",
        f"title: {json.dumps(printable(piece_title), ensure_ascii=False)}\n",
    ]
    yaml_lines += ["project: equidistant\n", "speakers:\n"]
    for azimuth, elevation, distance in speakers:
        speaker_place = (
            f"az: {_rounded_number(azimuth)}deg, el: {_rounded_number(elevation)}deg, r: "
            f"{_rounded_number(distance * distance_factor)}m"
        )
        yaml_lines.append(f"  - {{{speaker_place}}}\n")
    if [*output_numbers] != [*range(1, len(output_numbers) + 1)]:
        yaml_lines.append(f"outputs: [{', '.join(map(str, output_numbers))}]\n")
    return "".join(yaml_lines)
