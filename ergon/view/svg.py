"""Pictures as SVG: clean lines, units on the axes, dark on light, no script and no font file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from xml.sax.saxutils import escape, quoteattr

from .curve import CURVES_MAX, Axis, Curve, axis

# Safe for the colour-blind (Okabe & Ito, 2008) and different in dash: never by colour alone.
_STROKES = (("#0072b2", ""), ("#d55e00", "6 3"), ("#333333", "1.5 3"))
_TITLE_MAX = 60  # characters
_INK_COLOUR, _GRID_COLOUR, _PAPER_COLOUR = "#222222", "#dddddd", "#ffffff"
_FONT = "font-family='ui-sans-serif, Helvetica, Arial, sans-serif' font-size='12'"


@dataclass(frozen=True, slots=True)
class Frame:
    """A rectangle of the page with its two axes; its corners are in pixels."""

    left: float
    top: float
    right: float
    bottom: float
    t_axis: Axis
    x_axis: Axis

    def x_pixel(self, instant: float) -> float:
        """Pixel of an instant."""
        return self.left + self.t_axis.fraction(instant) * (self.right - self.left)

    def y_pixel(self, value: float) -> float:
        """Pixel of a value."""
        return self.bottom - self.x_axis.fraction(value) * (self.bottom - self.top)


def plot(
    curves: Sequence[Curve],
    *,
    title: str = "",
    width: int = 800,
    height: int = 360,
    t_label: str = "time [s]",
    x_label: str = "",
) -> str:
    """The same curves as `braille.plot`, as a whole SVG document."""
    if not 1 <= len(curves) <= CURVES_MAX:
        raise ValueError(f"a plot has 1 to {CURVES_MAX} curves, not {len(curves)}")
    frame = Frame(
        64,
        40,
        width - 16,
        height - 48,
        axis([t for curve in curves for t in curve.t], 8, tight=True),
        axis([x for curve in curves for x in curve.x], 6),
    )
    elements = [
        axes(frame, t_label, x_label),
        curve_paths(curves, frame),
        _legend(curves, frame),
    ]
    elements.append(text(frame.left, 20, shorten(title), weight="bold"))
    return document(width, height, title, elements)


def panels(
    labelled_plots: Sequence[tuple[str, Sequence[Curve]]], *, title: str, width: int = 900
) -> str:
    """Curves in frames one above the other over the same time, each with a label."""
    panel_height, panel_gap, margin_top = 190, 46, 44
    t_axis = axis(
        [t for _, curves in labelled_plots for curve in curves for t in curve.t], 8, tight=True
    )
    elements = [text(64, 20, shorten(title), weight="bold")]
    for panel_index, (panel_label, curves) in enumerate(labelled_plots):
        panel_top = margin_top + panel_index * (panel_height + panel_gap)
        x_axis = axis([x for curve in curves for x in curve.x], 5)
        frame = Frame(64, panel_top, width - 16, panel_top + panel_height, t_axis, x_axis)
        elements += [
            axes(frame, "time [s]" if panel_index == len(labelled_plots) - 1 else "", panel_label)
        ]
        elements += [curve_paths(curves, frame), _legend(curves, frame)]
    return document(
        width, margin_top + len(labelled_plots) * (panel_height + panel_gap), title, elements
    )


def curve_paths(curves: Sequence[Curve], frame: Frame) -> str:
    """The curves, each in its stroke."""
    return "\n".join(
        curve_path(curve, frame, stroke_index) for stroke_index, curve in enumerate(curves)
    )


def document(width: int, height: int, title: str, elements: Sequence[str]) -> str:
    """A whole SVG file round `elements`."""
    header = (
        f"<svg xmlns='http://www.w3.org/2000/svg' width='{width}' "
        f"height='{height}' "
        f"viewBox='0 0 {width} {height}' role='img' "
        f"aria-label={quoteattr(title)} {_FONT}>\n"
        "<!-- made by ergon -->\n"
        f"<title>{escape(title)}</title>\n"
        f"<rect width='{width}' height='{height}' fill='{_PAPER_COLOUR}'/>\n"
    )
    return header + "\n".join(part for part in elements if part) + "\n</svg>\n"


def axes(frame: Frame, t_label: str, x_label: str) -> str:
    """Grid, ticks, numbers and labels of a frame."""
    elements = []
    for tick in frame.t_axis.ticks:
        x = frame.x_pixel(tick)
        elements.append(_line(x, frame.top, x, frame.bottom))
        elements.append(text(x, frame.bottom + 16, frame.t_axis.text(tick), anchor="middle"))
    for tick in frame.x_axis.ticks:
        y = frame.y_pixel(tick)
        elements.append(_line(frame.left, y, frame.right, y))
        elements.append(text(frame.left - 6, y + 4, frame.x_axis.text(tick), anchor="end"))
    elements.append(
        f"<rect x='{frame.left:g}' y='{frame.top:g}' "
        f"width='{frame.right - frame.left:g}' "
        f"height='{frame.bottom - frame.top:g}' fill='none' stroke='{_INK_COLOUR}'/>"
    )
    elements.append(
        text(
            (frame.left + frame.right) / 2,
            frame.bottom + 36,
            t_label,
            anchor="middle",
        )
    )
    centre_y = (frame.top + frame.bottom) / 2
    elements.append(
        f"<text x='14' y='{centre_y:g}' fill='{_INK_COLOUR}' text-anchor='middle' "
        f"transform='rotate(-90 14 {centre_y:g})'>{escape(x_label)}</text>"
    )
    return "\n".join(elements)


def curve_path(curve: Curve, frame: Frame, stroke_index: int) -> str:
    """A curve in a frame, in the stroke of its number, below CURVES_MAX."""
    colour, dash = _STROKES[stroke_index]
    return (
        f"<path d='{_path(curve, frame)}' fill='none' stroke='{colour}' stroke-width='1.6' "
        f"stroke-linejoin='round'{_dash_attribute(dash)}/>"
    )


def legend_stroke(x: float, y: float, stroke_index: int) -> str:
    """A short line in the stroke of a curve's number, below CURVES_MAX."""
    colour, dash = _STROKES[stroke_index]
    return (
        f"<line x1='{x:g}' y1='{y:g}' x2='{x + 28:g}' y2='{y:g}' stroke='{colour}' "
        f"stroke-width='2'{_dash_attribute(dash)}/>"
    )


def shorten(title: str) -> str:
    """A title shortened to leave room for the text beside it."""
    return title if len(title) <= _TITLE_MAX else title[: _TITLE_MAX - 1] + "…"


def text(x: float, y: float, content: str, *, anchor: str = "start", weight: str = "normal") -> str:
    """Words at a place; nothing for no words."""
    if not content:
        return ""
    return (
        f"<text x='{x:.1f}' y='{y:.1f}' fill='{_INK_COLOUR}' text-anchor='{anchor}' "
        f"font-weight='{weight}'>{escape(content)}</text>"
    )


def _line(x1: float, y1: float, x2: float, y2: float) -> str:
    return (
        f"<line x1='{x1:.1f}' y1='{y1:.1f}' x2='{x2:.1f}' y2='{y2:.1f}' stroke='{_GRID_COLOUR}'/>"
    )


def _dash_attribute(dash: str) -> str:
    return f" stroke-dasharray='{dash}'" if dash else ""


def _path(curve: Curve, frame: Frame) -> str:
    """Path data; a gap begins a new subpath."""
    path_commands, path_command = [], "M"
    for t, x in zip(curve.t, curve.x, strict=True):
        if isfinite(t) and isfinite(x):
            path_commands.append(f"{path_command}{frame.x_pixel(t):.2f} {frame.y_pixel(x):.2f}")
            path_command = "L"
        else:
            path_command = "M"
    return "".join(path_commands)


def _legend(curves: Sequence[Curve], frame: Frame) -> str:
    elements, entry_left = [], frame.right
    for stroke_index, curve in reversed(list(enumerate(curves))):
        entry_left -= 7 * len(curve.name) + 44  # 7 pixels are a wide letter at 12 pixels
        elements.append(legend_stroke(entry_left, frame.top - 14, stroke_index))
        elements.append(text(entry_left + 33, frame.top - 10, curve.name))
    return "\n".join(elements)
