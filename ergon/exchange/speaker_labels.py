"""Loudspeakers by the labels of ITU-R BS.2051: `M+110` is in the middle layer, 110° to the left.

Two lists of them: the channels of the common definitions of ADM (ITU-R BS.2094-2, table 1), and
those of the mask of a WAVE file (Microsoft, "Multiple channel audio data and WAVE files").
"""

from __future__ import annotations

import re

from ergon.space.directions import Angles

_LABEL_PATTERN = re.compile(r"(UH|[MUBT])([+-])(SC|\d{3})(?:_Diff)?")
_ELEVATION_BY_LAYER = {"M": 0.0, "U": 30.0, "UH": 45.0, "B": -30.0, "T": 90.0}
_AZIMUTH_BY_CODE = {"022": 22.5, "SC": 25.0}  # the others are in degrees
_EFFECTS_PATTERN = re.compile(r"(RC_)?(LFE|SUB)", re.IGNORECASE)

# AC_00010001, AC_00010002, …
_COMMON_LABELS = [
    "M+030",
    "M-030",
    "M+000",
    "LFE",
    "M+110",
    "M-110",
    "M+022",
    "M-022",
    "M+180",
    "M+090",
    "M-090",
    "T+000",
    "U+030",
    "U+000",
    "U-030",
    "U+110",
    "U+180",
    "U-110",
    "U+090",
    "U-090",
    "B+000",
    "B+045",
    "B-045",
    "M+060",
    "M-060",
    "M+135_Diff",
    "M-135_Diff",
    "M+135",
    "M-135",
    "U+135",
    "U-135",
    "LFEL",
    "LFER",
    "U+045",
    "U-045",
    "M+SC",
    "M-SC",
    "M+045",
    "M-045",
    "UH+180",
]
# Bits of a mask, from the lowest on: the same, with the back ones further back.
_MASK_LABELS = [label.replace("110", "135") for label in _COMMON_LABELS[:18]]
_SIDES_MASK, _BACKS_MASK, _BACK_CENTRE_MASK = 0x600, 0x30, 0x100
# Of sides and backs, a file that has only one pair has the surround of 5.1 (BS.2051, system B).
_SURROUND_LABEL_BY_LABEL = {"M+135": "M+110", "M-135": "M-110", "M+090": "M+110", "M-090": "M-110"}


def is_low_frequency_effects(label: str) -> bool:
    """Whether a label, or a URN that ends in one, is that of low-frequency effects."""
    return bool(_EFFECTS_PATTERN.match(label.strip().rpartition(":")[2]))


def common_label(channel_format: str) -> str | None:
    """The label of a common definition, such as AC_00010005; None for another."""
    try:
        label_number = int(channel_format.removeprefix("AC_0001"), 16)
    except ValueError:
        return None
    is_known = channel_format.startswith("AC_0001") and 1 <= label_number <= len(_COMMON_LABELS)
    return _COMMON_LABELS[label_number - 1] if is_known else None


def labels_of_mask(mask: int) -> list[str]:
    """The labels of the channels of a mask; empty if it has bits that are not known."""
    if mask >> len(_MASK_LABELS):
        return []
    labels = [label for bit, label in enumerate(_MASK_LABELS) if mask >> bit & 1]
    has_backs, has_sides = bool(mask & _BACKS_MASK), bool(mask & _SIDES_MASK)
    if has_backs != has_sides and not (has_sides and mask & _BACK_CENTRE_MASK):
        labels = [_SURROUND_LABEL_BY_LABEL.get(label, label) for label in labels]
    return labels


def place_of(speaker_label: str) -> Angles | None:
    """Where a loudspeaker is, at the distance 1; None for low-frequency effects."""
    if is_low_frequency_effects(speaker_label):
        return None
    label_match = _LABEL_PATTERN.fullmatch(speaker_label)
    if label_match is None:
        raise ValueError(speaker_label)
    layer_code, sign, azimuth_code = label_match.groups()
    azimuth = _AZIMUTH_BY_CODE.get(azimuth_code) or float(azimuth_code)
    return (-azimuth if sign == "-" else azimuth), _ELEVATION_BY_LAYER[layer_code], 1.0
