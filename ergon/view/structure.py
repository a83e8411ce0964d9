"""Pictures of a structure: admittances over frequency, modes by pitch, shapes of modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, hypot, isfinite, log2, log10

from .curve import CURVES_MAX, Axis, Curve, axis
from .svg import Frame, axes, curve_path, document, legend_stroke, shorten, text

STAVE_MAX = 60  # modes of one part: more cannot be read
SHAPES_MAX = 12  # modes of one part
_DOTS_MAX = 2500  # masses of one shape
_WIDTH = 800  # pixels
_LETTER_WIDTH, _LINE_HEIGHT = 7.0, 15.0  # pixels that a wide letter and a line of text take
_UP_COLOUR, _DOWN_COLOUR, _LEADER_COLOUR = "#0072b2", "#d55e00", "#999999"


@dataclass(frozen=True, slots=True)
class PitchedMode:
    """A mode on a stave: frequency above 0 [Hz], cents from the nearest note, and a label."""

    frequency: float
    cents: float
    label: str


@dataclass(frozen=True, slots=True)
class Shape:
    """The shape of a mode: positions `x`, `y` [m] of the masses and their relative
    `displacements`, all (n_masses,).
    """

    label: str
    x: Sequence[float]
    y: Sequence[float]
    displacements: Sequence[float]


def admittance(curves: Sequence[Curve], *, title: str, height: int = 400) -> str:
    """Levels `x` [dB] of curves over frequencies `t` [Hz] on a logarithmic axis, as an SVG
    document.
    """
    if not 1 <= len(curves) <= CURVES_MAX:
        raise ValueError(f"a picture has 1 to {CURVES_MAX} curves, not {len(curves)}")
    curves_over_log_f = [
        Curve(curve.name, [log10(f) for f in curve.t], curve.x) for curve in curves
    ]
    t_axis = _frequency_axis(
        min(curve.t[0] for curve in curves), max(curve.t[-1] for curve in curves)
    )
    x_axis = axis([x for curve in curves for x in curve.x], 8)
    legend, n_legend_rows = _legend([curve.name for curve in curves])
    top = 36 + _LINE_HEIGHT * n_legend_rows
    frame = Frame(64, top, _WIDTH - 24, height - 48, t_axis, x_axis)
    elements = [text(64, 20, shorten(title), weight="bold"), *legend]
    elements.append(axes(frame, "frequency [Hz]", "velocity over force [dB re 1 (m/s)/N]"))
    elements += [
        curve_path(curve, frame, stroke_index)
        for stroke_index, curve in enumerate(curves_over_log_f)
    ]
    return document(_WIDTH, height, title, elements)


def stave(modes_by_part: Sequence[tuple[str, Sequence[PitchedMode]]], *, title: str) -> str:
    """The modes of each part by pitch and cents from the nearest note, as an SVG document.

    If a part has more than STAVE_MAX modes, the first ones are drawn.
    """
    elements, top = [text(64, 20, shorten(title), weight="bold")], 32.0
    for part_name, modes in modes_by_part:
        if not modes:
            elements.append(
                text(64, top + 14, f"{shorten(part_name)}: none of its modes is a note")
            )
            top += 30
            continue
        drawn_modes = sorted(modes[:STAVE_MAX], key=lambda mode: -mode.frequency)
        bottom = top + 24 + max(180.0, _LINE_HEIGHT * (len(drawn_modes) + 1))
        omission_note = (
            f" (the first {len(drawn_modes)} of {len(modes)} modes)" if modes[STAVE_MAX:] else ""
        )
        elements.append(text(64, top + 14, shorten(part_name) + omission_note))
        elements.append(_stave_of_part(drawn_modes, top + 24, bottom))
        top = bottom + 60
    return document(_WIDTH, int(top), title, elements)


def shapes(shapes_by_part: Sequence[tuple[str, Sequence[Shape]]], *, title: str) -> str:
    """The motion of masses in the modes of each part, drawn at their places on the bench, as an SVG
    document.

    If a part has more than SHAPES_MAX modes, the first ones are drawn. Masses in a row are drawn
    as a line displaced up and down; others as dots whose size is their motion, full for upwards
    and hollow for downwards.
    """
    elements, top = [text(24, 20, shorten(title), weight="bold")], 32.0
    n_columns, cell_width = 4, 184.0
    for part_name, part_shapes in shapes_by_part:
        drawn_shapes = part_shapes[:SHAPES_MAX]
        omission_note = (
            f" (the first {len(drawn_shapes)} of {len(part_shapes)} modes)"
            if part_shapes[SHAPES_MAX:]
            else ""
        )
        elements.append(text(24, top + 14, shorten(part_name) + omission_note))
        are_lines = all(_is_line(shape) for shape in drawn_shapes)
        cell_height = 90.0 if are_lines else cell_width - 24
        for shape_index, shape in enumerate(drawn_shapes):
            row, column = divmod(shape_index, n_columns)
            cell_left, cell_top = (
                24 + column * (cell_width + 6),
                top + 24 + row * (cell_height + 30),
            )
            label = shape.label[: int(cell_width / _LETTER_WIDTH)]
            elements.append(text(cell_left + cell_width / 2, cell_top + 12, label, anchor="middle"))
            elements.append(
                _mode_shape(shape, cell_left, cell_top + 18, cell_width - 8, cell_height - 8)
            )
        top += 40 + (cell_height + 30) * ceil(len(drawn_shapes) / n_columns)
    return document(_WIDTH, int(top), title, elements)


def _frequency_axis(frequency_min: float, frequency_max: float) -> Axis:
    """A logarithmic axis with ticks at 1, 2 and 5 times powers of ten; a short range has more
    ticks.
    """
    frequency_min, frequency_max = (
        (frequency_min, frequency_max)
        if frequency_max > frequency_min
        else (0.9 * frequency_min, 1.1 * frequency_max)
    )
    decades = range(floor(log10(frequency_min)), ceil(log10(frequency_max)) + 1)
    for factors in ((1, 2, 5), (1, 2, 3, 4, 5, 6, 7, 8, 9)):
        ticks = [factor * 10.0**power for power in decades for factor in factors]
        ticks = [f for f in ticks if frequency_min * (1 - 1e-9) <= f <= frequency_max * (1 + 1e-9)]
        if len(ticks) >= 3:
            break
    if len(ticks) < 3:
        ticks = list(axis([frequency_min, frequency_max], 6, tight=True).ticks)
    if len(ticks) > 16:
        ticks = [f for f in ticks if abs(log10(f) - round(log10(f))) < 1e-9]
    tick_labels = tuple(f"{f / 1000:.6g}k" if f >= 1000 else f"{f:.6g}" for f in ticks)
    return Axis(
        log10(frequency_min), log10(frequency_max), tuple(log10(f) for f in ticks), 0, tick_labels
    )


def _legend(curve_names: Sequence[str]) -> tuple[list[str], int]:
    """The legend below the title, and the number of rows that it takes."""
    elements, left, row = [], 64.0, 0
    width_max = _WIDTH - 24 - 64
    for stroke_index, name in enumerate(curve_names):
        curve_label = name[: int((width_max - 44) / _LETTER_WIDTH)]
        entry_width = 44 + _LETTER_WIDTH * len(curve_label)
        if left > 64 and left + entry_width > _WIDTH - 24:
            left, row = 64.0, row + 1
        baseline = 38 + _LINE_HEIGHT * row
        elements += [
            legend_stroke(left, baseline - 4, stroke_index),
            text(left + 33, baseline, curve_label),
        ]
        left += entry_width + 12
    return elements, row + 1


def _stave_of_part(modes: Sequence[PitchedMode], top: float, bottom: float) -> str:
    """Modes, the highest first: dots in a frame, and a column of words to its right."""
    label_column_width = 7 + _LETTER_WIDTH * max(len(mode.label) for mode in modes)
    right = max(_WIDTH - 24 - label_column_width - 40, _WIDTH / 2)
    pitches = [69 + 12 * log2(mode.frequency / 440) for mode in modes]
    lowest_key, highest_key = 12 * floor(min(pitches) / 12), 12 * ceil((max(pitches) + 1e-9) / 12)
    n_octaves_per_tick = max(
        1, ceil((highest_key - lowest_key) / 12 / ((bottom - top) / _LINE_HEIGHT))
    )
    c_keys = range(int(lowest_key), int(highest_key) + 1, 12 * n_octaves_per_tick)
    c_names = tuple(f"C{key // 12 - 1}".replace("-", "−") for key in c_keys)
    ticks = tuple(float(octave_key) for octave_key in c_keys)
    cents_axis = Axis(-55.0, 55.0, (-50.0, -25.0, 0.0, 25.0, 50.0), 0)
    frame = Frame(
        64,
        top,
        right,
        bottom,
        cents_axis,
        Axis(float(lowest_key), float(highest_key), ticks, 0, c_names),
    )
    elements = [axes(frame, "cents from the nearest note", "pitch")]
    dot_ys = [frame.y_pixel(pitch) for pitch in pitches]
    for mode, y, label_y in zip(
        modes, dot_ys, _spread_lines(dot_ys, top + 10, bottom), strict=True
    ):
        x = frame.x_pixel(mode.cents)
        elements.append(
            f"<path d='M{x:.1f} {y:.1f}L{right:.1f} {y:.1f}L{right + 30:.1f} "
            f"{label_y - 4:.1f}' "
            f"fill='none' stroke='{_LEADER_COLOUR}' stroke-width='0.6'/>"
        )
        elements.append(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='3.5' fill='{_UP_COLOUR}'/>")
        elements.append(text(right + 36, label_y, mode.label))
    return "\n".join(elements)


def _spread_lines(wanted_ys: Sequence[float], top: float, bottom: float) -> list[float]:
    """Heights for lines of text near the wanted ones, in rising order and at least a line apart."""
    line_ys: list[float] = []
    for wanted_y in wanted_ys:
        line_ys.append(max(wanted_y + 4, line_ys[-1] + _LINE_HEIGHT if line_ys else top))
    y_max = bottom
    for i in range(len(line_ys) - 1, -1, -1):
        line_ys[i] = min(line_ys[i], y_max)
        y_max = line_ys[i] - _LINE_HEIGHT
    return line_ys


def _is_line(shape: Shape) -> bool:
    x_extent = max(shape.x, default=0.0) - min(shape.x, default=0.0)
    return max(shape.y, default=0.0) - min(shape.y, default=0.0) <= 1e-9 * x_extent


def _mode_shape(
    shape: Shape,
    left: float,
    top: float,
    width: float,
    height: float,
) -> str:
    peak_displacement = (
        max(
            (abs(displacement) for displacement in shape.displacements if isfinite(displacement)),
            default=0.0,
        )
        or 1.0
    )
    box = (
        f"<rect x='{left:.1f}' y='{top:.1f}' width='{width:.1f}' "
        f"height='{height:.1f}' "
        "fill='none' stroke='#dddddd'/>"
    )
    stride = max(1, ceil(len(shape.x) / _DOTS_MAX))
    masses = sorted(zip(shape.x, shape.y, shape.displacements, strict=True))[::stride]
    x_min, y_min = min(shape.x), min(shape.y)
    x_extent, y_extent = max(shape.x) - x_min, max(shape.y) - y_min
    inner_width, inner_height = width - 16, height - 16
    if _is_line(shape):
        x_pixels = [
            left + 8 + inner_width * ((x - x_min) / x_extent if x_extent else 0.5)
            for x, _, _ in masses
        ]
        rest_y = top + height / 2
        y_pixels = [rest_y - 0.5 * inner_height * move / peak_displacement for _, _, move in masses]
        path_points = "L".join(f"{x:.1f} {y:.1f}" for x, y in zip(x_pixels, y_pixels, strict=True))
        dots = "".join(
            f"<circle cx='{x:.1f}' cy='{y:.1f}' r='1.6' fill='{_UP_COLOUR}'/>"
            for x, y in zip(x_pixels, y_pixels, strict=True)
            if len(masses) <= 120
        )
        rest_line = f"M{left:.1f} {rest_y:.1f}h{width:.1f}"
        return (
            f"{box}\n<path d='{rest_line}' fill='none' stroke='#dddddd'/>\n"
            f"<path d='M{path_points}' fill='none' stroke='{_UP_COLOUR}' stroke-width='1.2'/>{dots}"
        )
    pixels_per_metre = min(
        inner_width / x_extent if x_extent else inner_height / y_extent,
        inner_height / y_extent if y_extent else inner_width / x_extent,
    )
    radius_max = min(
        7.0, max(1.2, 0.5 * pixels_per_metre * hypot(x_extent, y_extent) / len(masses) ** 0.5)
    )
    centre_x, centre_y = left + width / 2, top + height / 2
    dots = "".join(
        _dot(
            centre_x + pixels_per_metre * (x - x_min - x_extent / 2),
            centre_y - pixels_per_metre * (y - y_min - y_extent / 2),
            radius_max * (abs(move) / peak_displacement) ** 0.5,
            move > 0,
        )
        for x, y, move in masses
        if abs(move) > 1e-3 * peak_displacement
    )
    return f"{box}\n{dots}"


def _dot(x: float, y: float, radius: float, is_up: bool) -> str:
    paint = (
        f"fill='{_UP_COLOUR}'"
        if is_up
        else f"fill='#ffffff' stroke='{_DOWN_COLOUR}' stroke-width='0.8'"
    )
    return f"<circle cx='{x:.1f}' cy='{y:.1f}' r='{max(radius, 0.3):.2f}' {paint}/>"
