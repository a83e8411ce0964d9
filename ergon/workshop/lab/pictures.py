"""Figures by matplotlib, an optional dependency of the laboratory; equal figures give equal SVG
files.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon.common.errors import ErgonError
from ergon.common.extras import install_command
from ergon.exchange.safe import MARK, file_group

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Safe for the colour-blind (Okabe & Ito, 2008).
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#333333")
_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "ergon",  # names of clip paths: by content, not by chance
    "svg.fonttype": "none",  # text stays text, for readers and search
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": "#e5e5e5",
    "grid.linewidth": 0.6,
}
_DPI = 144


class MatplotlibMissingError(ErgonError):
    """matplotlib is not installed; the message says how to install it."""


def save(
    draw: Callable[[], Figure], stem: Path, *, force: bool = False, png: bool = True
) -> list[Path]:
    """Draw once, write STEM.svg (and STEM.png), both or none."""
    contents = pictures(draw, stem, png=png)
    with file_group(force=force) as files:
        for path, content in contents.items():
            files.write(path, content)
    return list(contents)


def pictures(draw: Callable[[], Figure], stem: Path, *, png: bool = True) -> dict[Path, bytes]:
    """The contents of STEM.svg (and STEM.png). Raises MatplotlibMissingError."""
    try:
        import matplotlib
    except ImportError:
        raise MatplotlibMissingError(
            f"pictures need matplotlib: {install_command('lab')}"
        ) from None
    with matplotlib.rc_context(_STYLE):
        figure = draw()
        svg_bytes = _figure_bytes(figure, "svg", {"Date": None, "Creator": "ergon"})
        png_bytes = _figure_bytes(figure, "png", {"Software": MARK.decode()}) if png else b""
    svg_bytes = svg_bytes.replace(b"<svg ", b"<!-- " + MARK + b" -->\n<svg ", 1)
    _, svg_path, png_path = targets(stem)
    return {svg_path: svg_bytes, **({png_path: png_bytes} if png else {})}


def targets(stem: Path) -> list[Path]:
    """The files of a picture: its table, and its two image formats."""
    return [stem.with_name(f"{stem.name}.{extension}") for extension in ("csv", "svg", "png")]


def _figure_bytes(figure: Figure, extension: str, metadata: dict[str, str | None]) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format=extension, dpi=_DPI, metadata=metadata)
    return buffer.getvalue()
