"""Pictures of a structure: admittances over frequency, modes by pitch, shapes of modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, hypot, isfinite, log2, log10

from .curve import CURVES_MAX, Axis, Curve, axis
from .svg import Frame, axes, curve_path, document, key_line, short, text

STAVE_MAX = 60  # modes of one part: more cannot be read
SHAPES_MAX = 12  # modes of one part
_DOTS_MAX = 2500  # masses of one shape
_WIDTH = 800  # pixels
_LETTER_WIDTH, _LINE_HEIGHT = 7.0, 15.0  # pixels that a wide letter and a line of text take
_UP_COLOUR, _DOWN_COLOUR, _LEADER_COLOUR = "#0072b2", "#d55e00", "#999999"


@dataclass(frozen=True, slots=True)
class PitchedMode:
    """A mode on a stave: frequency above 0 [Hz], cents from the nearest note, and words."""

    frequency: float
    cents: float
    words: str


@dataclass(frozen=True, slots=True)
class Shape:
    """The shape of a mode: places `x`, `y` [m] of the masses and their relative motion `moves`,
    all (n_masses,).
    """

    words: str
    x: Sequence[float]
    y: Sequence[float]
    moves: Sequence[float]


def admittance(curves: Sequence[Curve], *, title: str, picture_height: int = 400) -> str:
    """Levels `x` [dB] of curves over frequencies `t` [Hz] on a logarithmic axis, as an SVG
    document.
    """
    if not 1 <= len(curves) <= CURVES_MAX:
        raise ValueError(f"a picture has 1 to {CURVES_MAX} curves, not {len(curves)}")
    log_curves = [Curve(curve.name, [log10(f) for f in curve.t], curve.x) for curve in curves]
    t_axis = _frequencies(min(curve.t[0] for curve in curves), max(curve.t[-1] for curve in curves))
    x_axis = axis([x for curve in curves for x in curve.x], 8)
    legend_parts, rows = _legend([curve.name for curve in curves])
    top = 36 + _LINE_HEIGHT * rows
    plot_frame = Frame(64, top, _WIDTH - 24, picture_height - 48, t_axis, x_axis)
    svg_parts = [text(64, 20, short(title), weight="bold"), *legend_parts]
    svg_parts.append(axes(plot_frame, "frequency [Hz]", "velocity over force [dB re 1 (m/s)/N]"))
    svg_parts += [curve_path(curve, plot_frame, number) for number, curve in enumerate(log_curves)]
    return document(_WIDTH, picture_height, title, svg_parts)


def stave(stave_parts: Sequence[tuple[str, Sequence[PitchedMode]]], *, title: str) -> str:
    """The modes of each part by pitch and cents from the nearest note, as an SVG document.

    If a part has more than STAVE_MAX modes, the first ones are drawn.
    """
    svg_parts, top_edge = [text(64, 20, short(title), weight="bold")], 32.0
    for part_name, pitched_modes in stave_parts:
        if not pitched_modes:
            svg_parts.append(
                text(64, top_edge + 14, f"{short(part_name)}: none of its modes is a note")
            )
            top_edge += 30
            continue
        drawn_modes = sorted(pitched_modes[:STAVE_MAX], key=lambda mode: -mode.frequency)
        bottom = top_edge + 24 + max(180.0, _LINE_HEIGHT * (len(drawn_modes) + 1))
        omission = (
            f" (the first {len(drawn_modes)} of {len(pitched_modes)} modes)"
            if pitched_modes[STAVE_MAX:]
            else ""
        )
        svg_parts.append(text(64, top_edge + 14, short(part_name) + omission))
        svg_parts.append(_stave_of(drawn_modes, top_edge + 24, bottom))
        top_edge = bottom + 60
    return document(_WIDTH, int(top_edge), title, svg_parts)


def shapes(shape_parts: Sequence[tuple[str, Sequence[Shape]]], *, title: str) -> str:
    """The motion of masses in the modes of each part, drawn at their places on the bench, as an SVG
    document.

    If a part has more than SHAPES_MAX modes, the first ones are drawn. Masses in a row are drawn
    as a line displaced up and down; others as dots whose size is their motion, full for upwards
    and hollow for downwards.
    """
    svg_parts, top_edge = [text(24, 20, short(title), weight="bold")], 32.0
    column_count, cell_size = 4, 184.0
    for part_name, part_shapes in shape_parts:
        drawn_shapes = part_shapes[:SHAPES_MAX]
        omission = (
            f" (the first {len(drawn_shapes)} of {len(part_shapes)} modes)"
            if part_shapes[SHAPES_MAX:]
            else ""
        )
        svg_parts.append(text(24, top_edge + 14, short(part_name) + omission))
        are_rows = all(_is_row(shape) for shape in drawn_shapes)
        cell_height = 90.0 if are_rows else cell_size - 24
        for number, shape in enumerate(drawn_shapes):
            row, column = divmod(number, column_count)
            cell_left, cell_top = (
                24 + column * (cell_size + 6),
                top_edge + 24 + row * (cell_height + 30),
            )
            words = shape.words[: int(cell_size / _LETTER_WIDTH)]
            svg_parts.append(text(cell_left + cell_size / 2, cell_top + 12, words, anchor="middle"))
            svg_parts.append(
                _shape(shape, cell_left, cell_top + 18, cell_size - 8, cell_height - 8)
            )
        top_edge += 40 + (cell_height + 30) * ceil(len(drawn_shapes) / column_count)
    return document(_WIDTH, int(top_edge), title, svg_parts)


def _frequencies(low_hertz: float, high_hertz: float) -> Axis:
    """A logarithmic axis with ticks at 1, 2 and 5 times powers of ten; a short range has more
    ticks.
    """
    low_hertz, high_hertz = (
        (low_hertz, high_hertz) if high_hertz > low_hertz else (0.9 * low_hertz, 1.1 * high_hertz)
    )
    decades = range(floor(log10(low_hertz)), ceil(log10(high_hertz)) + 1)
    for factors in ((1, 2, 5), (1, 2, 3, 4, 5, 6, 7, 8, 9)):
        ticks = [factor * 10.0**power for power in decades for factor in factors]
        ticks = [f for f in ticks if low_hertz * (1 - 1e-9) <= f <= high_hertz * (1 + 1e-9)]
        if len(ticks) >= 3:
            break
    if len(ticks) < 3:
        ticks = list(axis([low_hertz, high_hertz], 6, tight=True).ticks)
    if len(ticks) > 16:
        ticks = [f for f in ticks if abs(log10(f) - round(log10(f))) < 1e-9]
    names = tuple(f"{f / 1000:.6g}k" if f >= 1000 else f"{f:.6g}" for f in ticks)
    return Axis(log10(low_hertz), log10(high_hertz), tuple(log10(f) for f in ticks), 0, names)


def _legend(curve_names: Sequence[str]) -> tuple[list[str], int]:
    """The legend below the title, and the number of rows that it takes."""
    legend_parts, left_edge, row_index = [], 64.0, 0
    row_width = _WIDTH - 24 - 64
    for curve_number, name in enumerate(curve_names):
        curve_label = name[: int((row_width - 44) / _LETTER_WIDTH)]
        entry_width = 44 + _LETTER_WIDTH * len(curve_label)
        if left_edge > 64 and left_edge + entry_width > _WIDTH - 24:
            left_edge, row_index = 64.0, row_index + 1
        baseline = 38 + _LINE_HEIGHT * row_index
        legend_parts += [
            key_line(left_edge, baseline - 4, curve_number),
            text(left_edge + 33, baseline, curve_label),
        ]
        left_edge += entry_width + 12
    return legend_parts, row_index + 1


def _stave_of(pitched_modes: Sequence[PitchedMode], top_edge: float, bottom_edge: float) -> str:
    """Modes, the highest first: dots in a frame, and a column of words to its right."""
    label_column_width = 7 + _LETTER_WIDTH * max(len(mode.words) for mode in pitched_modes)
    right_edge = max(_WIDTH - 24 - label_column_width - 40, _WIDTH / 2)
    pitches = [69 + 12 * log2(mode.frequency / 440) for mode in pitched_modes]
    lowest_key, highest_key = 12 * floor(min(pitches) / 12), 12 * ceil((max(pitches) + 1e-9) / 12)
    octave_step = max(
        1, ceil((highest_key - lowest_key) / 12 / ((bottom_edge - top_edge) / _LINE_HEIGHT))
    )
    octave_keys = range(int(lowest_key), int(highest_key) + 1, 12 * octave_step)
    octave_names = tuple(f"C{octave_key // 12 - 1}".replace("-", "−") for octave_key in octave_keys)
    ticks = tuple(float(octave_key) for octave_key in octave_keys)
    cents_axis = Axis(-55.0, 55.0, (-50.0, -25.0, 0.0, 25.0, 50.0), 0)
    plot_frame = Frame(
        64,
        top_edge,
        right_edge,
        bottom_edge,
        cents_axis,
        Axis(float(lowest_key), float(highest_key), ticks, 0, octave_names),
    )
    svg_parts = [axes(plot_frame, "cents from the nearest note", "pitch")]
    dot_heights = [plot_frame.down(pitch) for pitch in pitches]
    for pitched_mode, y, label_height in zip(
        pitched_modes, dot_heights, _spaced(dot_heights, top_edge + 10, bottom_edge), strict=True
    ):
        x = plot_frame.across(pitched_mode.cents)
        svg_parts.append(
            f"<path d='M{x:.1f} {y:.1f}L{right_edge:.1f} {y:.1f}L{right_edge + 30:.1f} "
            f"{label_height - 4:.1f}' "
            f"fill='none' stroke='{_LEADER_COLOUR}' stroke-width='0.6'/>"
        )
        svg_parts.append(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='3.5' fill='{_UP_COLOUR}'/>")
        svg_parts.append(text(right_edge + 36, label_height, pitched_mode.words))
    return "\n".join(svg_parts)


def _spaced(heights_wanted: Sequence[float], top: float, bottom: float) -> list[float]:
    """Heights for lines of text near the wanted ones, in rising order and at least a line apart."""
    line_heights: list[float] = []
    for wanted in heights_wanted:
        line_heights.append(
            max(wanted + 4, line_heights[-1] + _LINE_HEIGHT if line_heights else top)
        )
    height_max = bottom
    for i in range(len(line_heights) - 1, -1, -1):
        line_heights[i] = min(line_heights[i], height_max)
        height_max = line_heights[i] - _LINE_HEIGHT
    return line_heights


def _is_row(shape: Shape) -> bool:
    x_extent = max(shape.x, default=0.0) - min(shape.x, default=0.0)
    return max(shape.y, default=0.0) - min(shape.y, default=0.0) <= 1e-9 * x_extent


def _shape(
    mode_shape: Shape,
    left_edge: float,
    top_edge: float,
    picture_width: float,
    picture_height: float,
) -> str:
    largest_move = (
        max((abs(move) for move in mode_shape.moves if isfinite(move)), default=0.0) or 1.0
    )
    box = (
        f"<rect x='{left_edge:.1f}' y='{top_edge:.1f}' width='{picture_width:.1f}' "
        f"height='{picture_height:.1f}' "
        "fill='none' stroke='#dddddd'/>"
    )
    stride = max(1, ceil(len(mode_shape.x) / _DOTS_MAX))
    masses = sorted(zip(mode_shape.x, mode_shape.y, mode_shape.moves, strict=True))[::stride]
    low_x, low_y = min(mode_shape.x), min(mode_shape.y)
    x_extent, y_extent = max(mode_shape.x) - low_x, max(mode_shape.y) - low_y
    room_width, room_height = picture_width - 16, picture_height - 16
    if _is_row(mode_shape):
        x_pixels = [
            left_edge + 8 + room_width * ((x - low_x) / x_extent if x_extent else 0.5)
            for x, _, _ in masses
        ]
        middle = top_edge + picture_height / 2
        y_pixels = [middle - 0.5 * room_height * move / largest_move for _, _, move in masses]
        path_points = "L".join(f"{x:.1f} {y:.1f}" for x, y in zip(x_pixels, y_pixels, strict=True))
        dots = "".join(
            f"<circle cx='{x:.1f}' cy='{y:.1f}' r='1.6' fill='{_UP_COLOUR}'/>"
            for x, y in zip(x_pixels, y_pixels, strict=True)
            if len(masses) <= 120
        )
        rest_line = f"M{left_edge:.1f} {middle:.1f}h{picture_width:.1f}"
        return (
            f"{box}\n<path d='{rest_line}' fill='none' stroke='#dddddd'/>\n"
            f"<path d='M{path_points}' fill='none' stroke='{_UP_COLOUR}' stroke-width='1.2'/>{dots}"
        )
    pixels_per_metre = min(
        room_width / x_extent if x_extent else room_height / y_extent,
        room_height / y_extent if y_extent else room_width / x_extent,
    )
    largest_radius = min(
        7.0, max(1.2, 0.5 * pixels_per_metre * hypot(x_extent, y_extent) / len(masses) ** 0.5)
    )
    centre_x, centre_y = left_edge + picture_width / 2, top_edge + picture_height / 2
    dots = "".join(
        _dot(
            centre_x + pixels_per_metre * (x - low_x - x_extent / 2),
            centre_y - pixels_per_metre * (y - low_y - y_extent / 2),
            largest_radius * (abs(move) / largest_move) ** 0.5,
            move > 0,
        )
        for x, y, move in masses
        if abs(move) > 1e-3 * largest_move
    )
    return f"{box}\n{dots}"


def _dot(x: float, y: float, radius: float, is_up: bool) -> str:
    paint = (
        f"fill='{_UP_COLOUR}'"
        if is_up
        else f"fill='#ffffff' stroke='{_DOWN_COLOUR}' stroke-width='0.8'"
    )
    return f"<circle cx='{x:.1f}' cy='{y:.1f}' r='{max(radius, 0.3):.2f}' {paint}/>"
