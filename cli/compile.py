"""`ergon compile`: the stream of ergons of a score."""

from __future__ import annotations

import click

from ergon.api import score
from ergon.api.options import ReadOptions

from . import options
from .console import Console


@click.command("compile")
@options.score
@options.target("The file to write. Default: stdout, as with -.")
@options.seed
@options.force
@options.trust
@options.with_console
def compile_score(
    console: Console,
    score_path: str,
    output: str | None,
    seed: int | None,
    force: bool,
    trust: bool,
) -> None:
    """Print the stream of ergons as CSV or JSON lines.

    Each row describes one ergon: its instant, the module that it strikes, the side, its mass, speed
    and impulse, and its place in the score. --json gives JSON lines instead of CSV.
    """
    from ergon.exchange.safe import open_for_writing
    from ergon.exchange.stream import ErgonNames, Form, stream_header
    from ergon.rendering.ergons import stream_ergons

    loaded = score.read(score_path, ReadOptions(trust=trust), console)
    stage = score.stage_recording(loaded, console, seed=seed)
    piece = score.piece_of(loaded)
    output_form: Form = "json" if console.json else "csv"
    reach_by_key = {name: key.reach for name, key in piece.keys.items()}
    ergon_names = ErgonNames(
        struck_name=stage.network.name_of,
        source_name=lambda index: str(stage.ergon_places[index]),
        lever_ratio=lambda struck: reach_by_key.get(struck.partition(".")[0], 1.0),
    )
    # Under --json the records of a progress bar would mix with the rows.
    progress_console = Console(quiet=console.quiet or console.json or output in (None, "-"))
    with (
        open_for_writing(
            output or "-", binary=False, force=force, inputs=loaded.inputs
        ) as output_file,
        progress_console.progress("compiling", stage.n_analysed_frames, stage.rate) as progress,
    ):
        header_text = stream_header(
            output_form, title=piece.title, rate=stage.rate, score=score.digest(piece)
        )
        output_file.write(header_text.encode())
        for ergon_text, frame in stream_ergons(
            stage.simulation, stage.n_analysed_frames, output_form, ergon_names
        ):
            output_file.write(ergon_text.encode())
            progress.update(frame)
