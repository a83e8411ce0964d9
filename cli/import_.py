"""`ergon import`: a model of another program as a score."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from . import options
from .console import Console
from .outcome import Refused, check_stdout

if TYPE_CHECKING:
    from ergon.workshop.api.model import Language
    from ergon.workshop.models.mims.laws import Laws


@click.command("import")
@click.argument("model", metavar="MODEL")
@options.target("The score to write, or - for stdout. Default: MODEL.yaml in the current folder.")
@click.option(
    "--dialect",
    type=click.Choice(["v1", "v2", "pmpd", "pmpd~", "sam", "miphysics"]),
    help="The language: v1 is MIMS, v2 mi-gen, sam Synth-A-Modeler. Without it the one that reads "
    "the model.",
)
@click.option(
    "--laws",
    type=click.Choice(["2019", "head"]),
    default="head",
    show_default=True,
    help="Laws of mi-gen as it was in 2019, or as it is.",
)
@click.option("--set", "values", metavar="NAME=VALUE", multiple=True, help="A parameter's value.")
@click.option(
    "--feed",
    "inputs",
    metavar="in1=FILE.wav",
    multiple=True,
    help="What feeds an input: one channel at 44,100 Hz, or osc. Without it the input is 0.",
)
@options.force
@options.with_console
def import_command(
    console: Console,
    model: str,
    output: str | None,
    dialect: Language | None,
    laws: Laws,
    values: tuple[str, ...],
    inputs: tuple[str, ...],
    force: bool,
) -> None:
    """Make a score of a model of another program.

    MODEL is a `.mdl` file of MIMS, mi-gen or Synth-A-Modeler, a Faust program made from one of
    MIMS, which has it as a comment, a list of messages to an object pmpd or pmpd~ of Pure Data, or
    an XML file of miPhysics. Under `units: ca` the score sounds the same sample for sample. A
    construct that a score cannot express is refused with its line.
    """
    from ergon.exchange.safe import check_target, write_text
    from ergon.workshop.api.model import ModelOptions, import_model

    output_path = output or f"{Path(model).stem}.yaml"
    check_stdout(output_path, is_json=console.json)
    feed_files = _pairs("--feed", inputs)
    read_files = [Path(model), *(Path(file) for file in feed_files.values() if file != "osc")]
    check_target(Path(output_path), force=force, inputs=read_files)
    model_options = ModelOptions(
        dialect=dialect, laws=laws, values=_pairs("--set", values), inputs=feed_files
    )
    score_folder = Path() if output_path == "-" else Path(output_path).parent
    imported = import_model(model, model_options, beside=score_folder)
    write_text(output_path, imported.text, force=force, inputs=read_files)
    if console.json:
        report_fields = {
            "dialect": imported.dialect,
            "statements": imported.n_statements,
            "unfed": imported.unfed,
        }
        console.record("wrote", file=output_path, **report_fields)
        return
    if output_path != "-":
        console.say(
            f"wrote {output_path}: {imported.n_statements:,} statements of {imported.dialect}"
        )
    if imported.unfed:
        names, feed_option = ", ".join(imported.unfed), f"--feed {imported.unfed[0]}=FILE.wav"
        stay_verb = "stays" if len(imported.unfed) == 1 else "stay"
        console.say(f"{names} {stay_verb} at 0; {feed_option} feeds {imported.unfed[0]}")


def _pairs(option_name: str, texts: tuple[str, ...]) -> dict[str, str]:
    value_by_name: dict[str, str] = {}
    for pair_text in texts:
        pair_name, equals, pair_value = pair_text.partition("=")
        if not (pair_name and equals and pair_value):
            raise Refused(f"{option_name} {pair_text}: write NAME=VALUE")
        if pair_name in value_by_name:
            raise Refused(f"{option_name} {pair_text}: {pair_name} is given twice")
        value_by_name[pair_name] = pair_value
    return value_by_name
