"""A piece as a page that moves and sounds, for a notebook or a file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from ergon.common.report import Report

from .options import FileOptions
from .share import share_file
from .viewing import render_view

_FRAME_HEIGHT_PIXELS = 480  # pixels of the frame in a notebook


@dataclass(frozen=True, slots=True)
class Page:
    """One file of HTML that needs no server and no network; notebooks show it as it moves."""

    html: str

    def write(self, path: str | Path, *, force: bool = False) -> None:
        """Write it into a file. With `force`, also over a file that ergon did not write.

        Raises FileRefusedError.
        """
        from ergon.exchange.safe import write_text

        write_text(str(path), self.html, force=force, inputs=())

    def _repr_html_(self) -> str:
        frame = (
            f"width='100%' height='{_FRAME_HEIGHT_PIXELS}' style='border:0' sandbox='allow-scripts'"
        )
        return f'<iframe {frame} srcdoc="{escape(self.html)}"></iframe>'


def page(
    score: str | Path, options: FileOptions | None = None, *, report: Report | None = None
) -> Page:
    """What `ergon view` shows of a score, with its sound, as `ergon share` writes it.

    Raises ScoreError, OptionError (also where it would be larger than 50 MB) and DivergedError.
    """
    report = report or Report()
    options = replace(options or FileOptions(), motion=True)
    with TemporaryDirectory(prefix="ergon-page-") as folder_name:
        folder = Path(folder_name)
        rendered_view = render_view(Path(score), folder, options, report)
        target = folder / "page.html"
        share_file(rendered_view, target, folder, report)
        return Page(target.read_text(encoding="utf-8"))
