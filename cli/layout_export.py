"""`ergon layout export`: a layout as other programs have it."""

from __future__ import annotations

from pathlib import Path

import click

from . import options
from .console import Console
from .outcome import Refused, check_stdout

FORMS = ("iem", "ear", "spatgris")
form = click.option(
    "--form",
    type=click.Choice(FORMS),
    help="iem (AllRADecoder, .json), ear (EBU ADM renderer, .yaml) or spatgris (.xml); without "
    "this option by the ending of the file.",
)


def form_of(path: Path, form_asked: str | None) -> str:
    """The format of a layout file: as asked for, or by its ending."""
    from ergon.exchange.layout_files import FORMS as LAYOUT_FORMS

    if form_asked is not None:
        return form_asked
    name_by_ending = {layout_form.ending: name for name, layout_form in LAYOUT_FORMS.items()}
    if path.suffix.lower() not in name_by_ending:
        form_list = ", ".join(f"{name} ({ending})" for ending, name in name_by_ending.items())
        raise Refused(f"{path}: its ending names no program; give --form, one of {form_list}")
    return name_by_ending[path.suffix.lower()]


@click.command()
@click.argument("name", metavar="LAYOUT")
@options.target("The file to write, or - for stdout.")
@form
@options.force
@options.with_console
def export(console: Console, name: str, output: str | None, form: str | None, force: bool) -> None:
    """Write a layout as other programs have it.

    LAYOUT is a file, or a layout that ships. The file is for the IEM AllRADecoder (JSON), the EBU
    ADM renderer (YAML) or SpatGRIS (XML, whose farthest loudspeaker is at the distance 1).
    """
    from ergon.api.layouts import read_layout
    from ergon.exchange.layout_files import FORMS as LAYOUT_FORMS
    from ergon.exchange.safe import write_text
    from ergon.space.directions import angles

    if output is None:
        raise Refused("name the file to write, by -o FILE.json, FILE.yaml or FILE.xml")
    check_stdout(output, is_json=console.json)
    if output == "-" and form is None:
        raise Refused(f"-o - needs --form, one of {', '.join(FORMS)}")
    path = Path(output)
    layout_form = form_of(path, form)
    layout = read_layout(name, console)
    speaker_angles = [angles(place) for place in layout.speakers]
    outputs = [channel + 1 for channel in layout.channels]
    text = LAYOUT_FORMS[layout_form].write(
        speaker_angles, outputs, layout.title or layout.path.stem
    )
    write_text(output, text, force=force, inputs=(layout.path,))
    if console.json:
        console.record("wrote", file=output, form=layout_form, loudspeakers=len(speaker_angles))
    elif output != "-":
        console.say(f"wrote {output}: {len(speaker_angles)} loudspeakers for {layout_form}")
