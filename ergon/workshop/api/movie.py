"""A film of a piece: what `ergon view` shows, picture by picture, with its sound."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.api.errors import OptionError
from ergon.common.report import Report

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.api.viewing import Shown
    from ergon.workshop.movies.chromium import Page
    from ergon.workshop.movies.video import Sound

_SIZE = re.compile(r"(\d{1,5})x(\d{1,5})")
_SECONDS = re.compile(r"(\d{1,7}(?:\.\d{1,9})?)s")
_STOP = re.compile(rf"([1-9])(?:@{_SECONDS.pattern})?")
_SIDE_MIN, _SIDE_MAX = 64, 4096  # px
_RATE_MAX = 120  # pictures a second
_PICTURES_MAX = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class MovieOptions:
    """Options of a film.

    `size`: width x height [px], even numbers; `rate`: pictures a second; `camera`: views of the
    page, 1 to 9, and when each is reached, such as "1@0s 3@12s": between two, the camera moves;
    `start` and `end`: a time of the piece such as "90s", or the name of a mark; `words`: also
    draw the texts of the page; `browser`: the program that draws, by default the first of
    Chromium and Chrome that is installed.
    """

    size: str = "1280x720"
    rate: int = 30
    camera: str = "1"
    start: str | None = None
    end: str | None = None
    words: bool = False
    strobe: bool = False
    force: bool = False
    browser: str | None = None


@dataclass(frozen=True, slots=True)
class Movie:
    """What was written: a video file or a folder of pictures."""

    path: str
    n_pictures: int
    seconds: float
    width: int
    height: int
    has_sound: bool


class MovieMaker:
    """A film to make. What can be refused before a piece is rendered is refused at once."""

    def __init__(self, target: str | Path, options: MovieOptions | None = None) -> None:
        """Raise OptionError, FileRefusedError, VideoError and BrowserError."""
        from ergon.exchange.safe import check_target
        from ergon.workshop.movies import chromium, video

        self._options = options = options or MovieOptions()
        self._target = Path(target)
        self._size = _parse_size(options.size)
        self._view_times = _parse_view_times(options.camera)
        if not 1 <= options.rate <= _RATE_MAX:
            raise OptionError("fps", f"1 to {_RATE_MAX} pictures a second", value=str(options.rate))
        self._suffix = self._target.suffix.lower()
        self._is_folder = str(target).endswith("/") or not self._suffix or self._target.is_dir()
        if self._is_folder:
            _check_folder(self._target)
        elif self._suffix not in video.SUFFIXES:
            kinds = ", ".join(video.SUFFIXES)
            reason = f"films end in {kinds}; a name that ends in / is a folder of pictures"
            raise OptionError("movie", reason, value=str(target))
        else:
            check_target(self._target, force=options.force)
            video.check_pyav()
        self._program = chromium.find_browser(options.browser)

    def make(self, view: Shown, report: Report | None = None) -> Movie:
        """Draw the film.

        Raises OptionError (a view or a stretch that the piece does not have), BrowserError,
        VideoError, and OSError where files cannot be read or written.
        """
        from ergon.api.pages import ANY_LOCAL_PORT, serve
        from ergon.workshop.movies import chromium

        report, options = report or Report(), self._options
        server = serve(ANY_LOCAL_PORT, "at", report, view.motion)
        page_words = ["t=0", *(["stage"] * (not options.words)), *(["strobe"] * options.strobe)]
        try:
            with (
                chromium.launch_browser(self._program) as browser,
                browser.page(*self._size) as page,
            ):
                page.open(f"{server.url}?{'&'.join(page_words)}")
                instants = self._instants(page)
                self._set_views(page)
                return self._draw(page, instants, view, report)
        finally:
            server.close()

    def _instants(self, page: Page) -> list[float]:
        """The instant of each picture [s]."""
        options = self._options
        duration = float(page.run("ergon.page.story.duration"))
        script = "ergon.page.story.model.marks.map((mark) => [mark.name, mark.seconds])"
        marks = dict(page.run(script))
        start_seconds, end_seconds = (
            _parse_instant("from", options.start, marks),
            _parse_instant("to", options.end, marks),
        )
        start_seconds, end_seconds = (
            start_seconds or 0.0,
            duration if end_seconds is None else min(end_seconds, duration),
        )
        if start_seconds >= duration:
            reason = f"the piece ends at {duration:.2f} s"
            raise OptionError("from", reason, value=options.start)
        if start_seconds >= end_seconds:
            raise OptionError(
                "to", "the end of a film must be after its beginning", value=options.end
            )
        picture_count = max(1, round((end_seconds - start_seconds) * options.rate))
        if picture_count > _PICTURES_MAX:
            raise OptionError(
                "fps", f"{picture_count:,} pictures; a film has at most {_PICTURES_MAX:,}"
            )
        return [
            start_seconds + picture_index / options.rate for picture_index in range(picture_count)
        ]

    def _set_views(self, page: Page) -> None:
        stops = [[reached_at, view - 1] for view, reached_at in self._view_times]
        view_count = page.run(f"ergon.page.travel({json.dumps(stops)})")
        if view_count is not None:
            reason = f"the piece has the views 1 to {view_count}"
            raise OptionError("camera", reason, value=self._options.camera)

    def _draw(self, page: Page, instants: list[float], view: Shown, report: Report) -> Movie:
        from ergon.exchange.new_folder import new_folder
        from ergon.exchange.safe import open_for_writing
        from ergon.workshop.movies.video import VideoFile

        options, picture_count = self._options, len(instants)
        stretch_sound = None
        with ExitStack() as stack:
            if self._is_folder:
                folder = stack.enter_context(new_folder(self._target))
            else:
                force = options.force
                movie_file = stack.enter_context(
                    open_for_writing(self._target, binary=True, force=force)
                )
                if view.sound is not None:
                    stretch = instants[0], instants[0] + picture_count / options.rate
                    stretch_sound = _sound(view.sound, *stretch)
                video_file = VideoFile(
                    movie_file, self._suffix, self._size, options.rate, stretch_sound
                )
                stack.callback(video_file.discard)
            progress = stack.enter_context(report.progress("drawing", picture_count, options.rate))
            for picture_index, instant in enumerate(instants):
                page.run(f"ergon.seek({instant!r})")
                picture = page.picture()
                if self._is_folder:
                    (folder / f"{picture_index:06}.png").write_bytes(picture)
                else:
                    video_file.add(picture)
                progress.update(picture_index + 1)
            if not self._is_folder:
                video_file.close()
        return Movie(
            str(self._target),
            picture_count,
            picture_count / options.rate,
            *self._size,
            stretch_sound is not None,
        )


def _parse_size(size_text: str) -> tuple[int, int]:
    match = _SIZE.fullmatch(size_text)
    dimensions = [int(side) for side in match.groups()] if match else []
    if not dimensions or any(side % 2 or not _SIDE_MIN <= side <= _SIDE_MAX for side in dimensions):
        reason = f"write two even numbers from {_SIDE_MIN} to {_SIDE_MAX}, such as 1920x1080"
        raise OptionError("size", reason, value=size_text)
    return dimensions[0], dimensions[1]


def _parse_view_times(views_text: str) -> list[tuple[int, float]]:
    """Views, and when each is reached [s]."""
    stops: list[tuple[int, float]] = []
    for word in views_text.split():
        stop_match = _STOP.fullmatch(word)
        if stop_match is None or (stop_match[2] is None and stops):
            reason = "write views and when they are reached, such as '1@0s 3@12s'"
            raise OptionError("camera", reason, value=views_text)
        stops.append((int(stop_match[1]), float(stop_match[2] or 0.0)))
    times = [reached_at for _, reached_at in stops]
    if not stops or any(
        instant_after <= instant_before for instant_before, instant_after in pairwise(times)
    ):
        raise OptionError(
            "camera", "each view must be reached later than the one before it", value=views_text
        )
    return stops


def _parse_instant(
    option: str, instant_text: str | None, mark_instants: dict[str, float]
) -> float | None:
    """An instant [s] of the piece: as seconds, or the name of a mark. Raises OptionError."""
    if instant_text is None:
        return None
    if match := _SECONDS.fullmatch(instant_text):
        return float(match[1])
    if instant_text in mark_instants:
        return mark_instants[instant_text]
    mark_list = (
        f" or a mark: {', '.join(mark_instants)}" if mark_instants else "; the piece has no marks"
    )
    raise OptionError(option, f"write seconds such as 90s{mark_list}", value=instant_text)


def _check_folder(folder: Path) -> None:
    from ergon.exchange.new_folder import check_new_folder
    from ergon.exchange.safe import FileRefusedError

    try:
        check_new_folder(folder)
    except FileRefusedError:
        reason = f"{folder} is not an empty folder; pictures go into a new one"
        raise OptionError("movie", reason) from None


def _sound(path: Path, start_seconds: float, end_seconds: float) -> Sound:
    """A stretch [s] of a WAV file."""
    from ergon.exchange import sound
    from ergon.workshop.movies.video import Sound

    format = sound.read_info(path).format
    start_frame, stop_frame = (
        round(seconds * format.rate) for seconds in (start_seconds, end_seconds)
    )
    return Sound(_frames_between(path, start_frame, stop_frame), format.rate, format.n_channels)


def _frames_between(path: Path, start_frame: int, stop_frame: int) -> Iterator[NDArray[np.float64]]:
    """The frames of a file from `start_frame` up to `stop_frame`, which is left out."""
    from ergon.exchange import sound

    block_begin = 0
    for block in sound.read_blocks(path):
        frames_between = block[max(0, start_frame - block_begin) : max(0, stop_frame - block_begin)]
        block_begin += len(block)
        if len(frames_between):
            yield frames_between
        if block_begin >= stop_frame:
            return
