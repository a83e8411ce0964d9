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
@options.speaking
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
    an XML file of miPhysics. Under `units: ca` the score sounds the same sample for sample. What no
    score says is refused, with its line.
    """
    from ergon.exchange.safe import check_target, write_text
    from ergon.workshop.api.model import ModelOptions, import_model

    target = output or f"{Path(model).stem}.yaml"
    check_stdout(target, is_json=console.json)
    files = _pairs("--feed", inputs)
    read_files = [Path(model), *(Path(file) for file in files.values() if file != "osc")]
    check_target(Path(target), force=force, inputs=read_files)
    model_options = ModelOptions(
        dialect=dialect, laws=laws, values=_pairs("--set", values), inputs=files
    )
    score_folder = Path() if target == "-" else Path(target).parent
    imported = import_model(model, model_options, beside=score_folder)
    write_text(target, imported.text, force=force, inputs=read_files)
    if console.json:
        fields = {
            "dialect": imported.dialect,
            "statements": imported.n_statements,
            "unfed": imported.unfed,
        }
        console.record("wrote", file=target, **fields)
        return
    if target != "-":
        console.say(f"wrote {target}: {imported.n_statements:,} statements of {imported.dialect}")
    if imported.unfed:
        names, feed = ", ".join(imported.unfed), f"--feed {imported.unfed[0]}=FILE.wav"
        stay = "stays" if len(imported.unfed) == 1 else "stay"
        console.say(f"{names} {stay} at 0; {feed} feeds {imported.unfed[0]}")


def _pairs(option: str, texts: tuple[str, ...]) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise Refused(f"{option} {text}: write NAME=VALUE")
        if name in pairs:
            raise Refused(f"{option} {text}: {name} is given twice")
        pairs[name] = value
    return pairs
