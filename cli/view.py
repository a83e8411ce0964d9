"""`ergon view`: what moved, in a browser."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

from . import options
from .bundled import ScorePath
from .console import Console
from .outcome import Refused
from .signals import until_interrupted
from .units import seconds_text

if TYPE_CHECKING:
    from ergon.api.render import PreparedRender
    from ergon.api.viewing import Shown
    from ergon.workshop.api.movie import MovieMaker

_MOTION_MAGIC = b"ERGM"  # docs/motion.md


# Names of MovieOptions; the command refuses them without --movie.
_film_options = options.several(
    click.option(
        "--movie",
        metavar="OUT.webm|OUT.mp4|FOLDER/",
        help="Draw a film with its sound, or its pictures (PNG) into a folder; serve nothing.",
    ),
    click.option("--size", metavar="WxH", help="Of the film [px]. Default: 1280x720."),
    click.option("--fps", "rate", type=int, help="Pictures a second of the film. Default: 30."),
    click.option(
        "--camera",
        metavar="VIEWS",
        help="Views of the film (the page's keys 1 to 9), and when each is reached: '1@0s 3@12s'. "
        "Default: 1.",
    ),
    click.option("--from", "start", metavar="TIME", help="Begin the film here: 90s, or a mark."),
    click.option("--until", "end", metavar="TIME", help="End the film here: 120s, or a mark."),
    click.option(
        "--words", is_flag=True, default=None, help="Show the text of the page in the film too."
    ),
)
_FLAG_BY_OPTION = {
    "rate": "fps",
    "start": "from",
    "end": "until",
}  # flags that are named differently


@click.command()
@click.argument("score_path", metavar="SCORE|FILE.motion", type=ScorePath())
@click.option(
    "--sound",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Play this sound file with FILE.motion. Default: FILE.wav beside it, of the same score.",
)
@click.option(
    "--see",
    type=click.Choice(["all"]),
    help="Of a score: all also computes parts that are not heard.",
)
@click.option(
    "--at",
    "address",
    metavar="HOST:PORT",
    default="127.0.0.1:0",
    show_default=True,
    help="Serve here; port 0 is any free one. The address has a key.",
)
@click.option(
    "--stage",
    is_flag=True,
    help="For projectors: full screen after a click, no pointer, no words, black where the line "
    "is lost.",
)
@click.option(
    "--strobe", is_flag=True, help="Let flashes cover more of the picture than WCAG 2.3.1 allows."
)
@_film_options
@options.force
@options.trust
@options.with_console
def view(
    console: Console,
    score_path: str,
    sound: Path | None,
    see: str | None,
    address: str,
    stage: bool,
    strobe: bool,
    movie: str | None,
    force: bool,
    trust: bool,
    **film: Any,
) -> None:
    """Show in a browser what moves in a piece, with its sound.

    The command prints an address and serves the page there until Ctrl-C. A score is rendered first;
    the page plays that, or what `ergon render --motion` wrote. Press H in it for its keys. With
    --movie a browser without a window draws a film, picture by picture.
    """
    path = Path(score_path)
    film_options = {name: value for name, value in film.items() if value is not None}
    if movie is None and film_options:
        name = next(iter(film_options))
        raise Refused(
            f"--{_FLAG_BY_OPTION.get(name, name)} needs --movie; it says how a film is made"
        )
    movie_maker = (
        None
        if movie is None
        else _movie_maker(movie, film_options | {"strobe": strobe, "force": force})
    )
    with TemporaryDirectory(prefix="ergon-view-") as folder:
        view_files = shown_of(console, path, Path(folder), sound_path=sound, trust=trust, see=see)
        if movie_maker is not None:
            _film(console, movie_maker, view_files)
            return
        asked_by_option = {"sound": view_files.sound is not None, "stage": stage, "strobe": strobe}
        serve_shown(
            console,
            view_files,
            address,
            [name for name, is_asked in asked_by_option.items() if is_asked],
        )


def shown_of(
    console: Console,
    path: Path,
    folder: Path,
    *,
    sound_path: Path | None,
    trust: bool,
    check: Callable[[PreparedRender], None] | None = None,
    **render_options: str | None,
) -> Shown:
    """What a page shows of a motion file, or of a score that is rendered into a folder.

    `render_options` are those of `FileOptions`, for a score alone; `check` may refuse a score
    before it is computed. Raises Refused.
    """
    is_motion = _is_motion(path)
    if sound_path is not None and not is_motion:
        raise Refused(
            "--sound needs a .motion file, because a score is rendered with "
            "its sound; leave --sound out"
        )
    option_name = next((name for name, value in render_options.items() if value is not None), None)
    if option_name is not None and is_motion:
        raise Refused(
            f"--{option_name} needs a score, because what {path} holds is fixed; leave "
            f"--{option_name} out"
        )
    if is_motion:
        return _shown_motion(console, path, sound_path, folder)
    from ergon.api.options import FileOptions
    from ergon.api.viewing import render_view

    file_options = FileOptions(motion=True, trust=trust, **render_options)  # type: ignore[arg-type]
    return render_view(path, folder, file_options, console, check)


def _shown_motion(console: Console, path: Path, sound_path: Path | None, folder: Path) -> Shown:
    from ergon.api.viewing import Shown, binaural_file, sound_beside
    from ergon.exchange.wave_header import NotWaveError

    sound_file = sound_path or sound_beside(path, console)
    try:
        return Shown(
            path, None if sound_file is None else binaural_file(sound_file, folder, console)
        )
    except NotWaveError as error:
        raise Refused(f"{sound_file}: {error}") from None


def serve_shown(console: Console, shown: Shown, address: str, options_asked: list[str]) -> None:
    """Serve the page with a motion file until Ctrl-C; `options_asked` are words of the page's
    address.
    """
    from ergon.api.pages import serve

    server = serve(address, "at", console, shown.motion, shown.sound)
    try:
        url = server.url + ("?" + "&".join(options_asked) if options_asked else "")
        if console.json:
            console.record("ready", url=url)
        else:
            print(url, flush=True)
        until_interrupted()
    finally:
        server.close()


def _movie_maker(movie: str, film_options: dict[str, Any]) -> MovieMaker:
    from ergon.workshop.api.movie import MovieMaker, MovieOptions

    return MovieMaker(movie, MovieOptions(**film_options))


def _film(console: Console, maker: MovieMaker, shown: Shown) -> None:
    film_made = maker.make(shown, console)
    if console.json:
        console.record(
            "filmed",
            file=film_made.path,
            pictures=film_made.n_pictures,
            seconds=film_made.seconds,
            width=film_made.width,
            height=film_made.height,
            sound=film_made.has_sound,
        )
        return
    sound_words = "with sound" if film_made.has_sound else "no sound"
    console.say(
        f"{film_made.path}: {film_made.n_pictures:,} pictures of "
        f"{film_made.width}x{film_made.height}, "
        f"{seconds_text(film_made.seconds)}, {sound_words}"
    )


def _is_motion(path: Path) -> bool:
    """Whether a file is a motion file, by its first bytes; else it is a score. Raises Refused."""
    from ergon.common.regular import open_regular

    with open_regular(path) as file:  # a pipe's other end would be waited for
        begins = file.read(len(_MOTION_MAGIC))
    if begins == _MOTION_MAGIC:
        return True
    if path.suffix in (".yaml", ".yml"):
        return False
    message = f"{path} is neither a score (.yaml) nor a .motion file, which begins with "
    raise Refused(message + _MOTION_MAGIC.decode())
