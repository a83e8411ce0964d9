"""`ergon layout import`: another program's file as a layout."""

from __future__ import annotations

from pathlib import Path

import click

from . import options
from .console import Console
from .layout_export import form, form_of
from .outcome import Refused, check_stdout


@click.command()
@click.argument("file", metavar="FILE")
@options.target("The layout to write, a .yaml file, or - for stdout.")
@form
@click.option(
    "--radius",
    metavar="LENGTH",
    help="How far away the farthest loudspeaker is, such as 3m; SpatGRIS does not say it.",
)
@options.force
@options.with_console
def import_layout(
    console: Console,
    file: str,
    output: str | None,
    form: str | None,
    radius: str | None,
    force: bool,
) -> None:
    """Make a layout of a file of another program.

    FILE is one of the IEM AllRADecoder (JSON), the EBU ADM renderer (YAML) or SpatGRIS (XML). The
    positions and outputs of loudspeakers are kept; gains, filters and imaginary loudspeakers are
    not. Direct outs and low-frequency effects are left out and named.
    """
    from ergon.common.regular import read_bounded
    from ergon.exchange.layout_files import FILE_BYTES_MAX, FORMS, LayoutFileError, as_yaml
    from ergon.exchange.safe import write_text

    path = Path(file)
    output_path = output or f"{path.stem}-layout.yaml"
    check_stdout(output_path, is_json=console.json)
    layout_form = form_of(path, form)
    radius_metres = None if radius is None else _metres(radius)
    layout_bytes = read_bounded(path, FILE_BYTES_MAX)
    if len(layout_bytes) > FILE_BYTES_MAX:
        raise Refused(f"{file} is larger than {FILE_BYTES_MAX >> 20} MB")
    try:
        layout = FORMS[layout_form].read(layout_bytes)
    except LayoutFileError as error:
        raise Refused(f"{file}: {error}") from None
    speakers = layout.speakers
    for note in layout.notes():
        console.warn(f"{file}: {note}")
    text = as_yaml(speakers, path.stem, radius_metres, layout.outputs)
    write_text(output_path, text, force=force, inputs=(path,))
    if console.json:
        console.record("wrote", file=output_path, form=layout_form, loudspeakers=len(speakers))
    elif output_path != "-":
        console.say(f"wrote {output_path}: {len(speakers)} loudspeakers")


def _metres(radius_text: str) -> float:
    from ergon.notation.tables.quantities import DISTANCE, quantity
    from ergon.notation.text.errors import TextError

    try:
        return quantity(radius_text, DISTANCE)
    except TextError as error:
        raise Refused(f"--radius: {error.message}") from None
