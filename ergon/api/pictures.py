"""What notebooks show of results: pictures, tables, and sound that can be played."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_EARS = 2


@dataclass(frozen=True, slots=True)
class Picture:
    """A drawing as text of SVG; notebooks show it."""

    svg: str

    @classmethod
    def read(cls, path: str | Path) -> Picture:
        """A picture that a command wrote, such as `ergon chart`. Raises OSError."""
        return cls(Path(path).read_text(encoding="utf-8"))

    def write(self, path: str | Path, *, force: bool = False) -> None:
        """Write it into a file. With `force`, also over a file that ergon did not write.

        Raises FileRefusedError.
        """
        from ergon.exchange.safe import file_group

        with file_group(force=force, inputs=()) as files:
            files.write(str(path), self.svg.encode())

    def _repr_svg_(self) -> str:
        return self.svg


def table_html(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of texts as HTML."""

    def row_html(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    body = "".join(row_html(row, "td") for row in rows)
    return f"<table><thead>{row_html(header, 'th')}</thead><tbody>{body}</tbody></table>"


def audio_html(frames: NDArray[np.float64], rate: float) -> str:
    """Sound (n_frames, n_channels) as an element of HTML that plays it, without any file.

    It is FLAC of 16 bits. Of more than two channels the odd ones are heard on the left, the even
    ones on the right; what exceeds full scale is turned down.
    """
    import numpy as np
    import soundfile

    n_channels = min(frames.shape[1], _EARS)
    ear_signals = np.stack(
        [frames[:, first_channel::_EARS].mean(axis=1) for first_channel in range(n_channels)],
        axis=1,
    )
    ear_signals /= max(1.0, float(np.max(np.abs(ear_signals), initial=0.0)))
    file = BytesIO()
    soundfile.write(file, ear_signals, round(rate), format="FLAC", subtype="PCM_16")
    sound = base64.b64encode(file.getvalue()).decode()
    return f"<audio controls src='data:audio/flac;base64,{sound}'></audio>"
