"""`ergon share`: a piece as one file for a browser."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import click

from . import options
from .bundled import ScorePath
from .console import Console
from .view import shown_of


@click.command()
@click.argument("path", metavar="SCORE|FILE.motion", type=ScorePath())
@click.option("-o", "--output", metavar="FILE.html", help="Default: SCORE.html here.")
@click.option(
    "--sound",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Play this sound file with FILE.motion. Default: FILE.wav beside it, of the same score.",
)
@click.option("--until", metavar="POSITION", help="End a score here: bar|beat, seconds or a mark.")
@click.option(
    "--limit",
    type=options.Number(0.1, 2000),
    default=50.0,
    show_default=True,
    metavar="MB",
    help="Write no larger file.",
)
@click.option(
    "--strobe", is_flag=True, help="Let flashes cover more of the picture than WCAG 2.3.1 allows."
)
@options.force
@options.trust
@options.with_console
def share(
    console: Console,
    path: str,
    output: str | None,
    sound: Path | None,
    until: str | None,
    limit: float,
    strobe: bool,
    force: bool,
    trust: bool,
) -> None:
    """Write a piece as one HTML file that plays in any browser, without a network.

    It holds the page of `ergon view`, what moves and the sound (FLAC, 16 bits, two channels at
    most), and asks no server for anything: open it from the disk, send it, put it on a site.
    """
    from functools import partial

    from ergon.api.share import check_estimate, share_file

    source_path = Path(path)
    output_path = Path(output or f"{source_path.stem}.html")
    with TemporaryDirectory(prefix="ergon-share-") as folder:
        check = partial(check_estimate, path=output_path, limit_mb=limit)
        view_files = shown_of(
            console,
            source_path,
            Path(folder),
            sound_path=sound,
            trust=trust,
            check=check,
            until=until,
        )
        shared_file = share_file(
            view_files,
            output_path,
            Path(folder),
            console,
            limit_mb=limit,
            force=force,
            inputs=tuple(file for file in (source_path, sound) if file is not None),
            words=("strobe",) if strobe else (),
        )
    if console.json:
        console.record(
            "shared",
            file=shared_file.path,
            bytes=shared_file.size,
            motion=shared_file.motion,
            sound=shared_file.sound,
        )
        return
    console.say(f"{shared_file.path}: {shared_file.size / 1e6:.1f} MB, opens in any browser")
