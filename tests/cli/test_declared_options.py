"""Options of commands are those that the library declares, with the same words."""

from dataclasses import fields, make_dataclass

import click
import pytest

import ergon
from ergon.api.emulate import EmulationOptions
from ergon.api.options import AccuracyOptions, FileOptions, PlayOptions, SessionOptions
from ergon.cli import options
from ergon.cli.app import group
from ergon.common.option import Choice, Integer, Number, Option, Quantities, Text, option

COMMANDS = {
    "render": FileOptions,
    "plan": AccuracyOptions,
    "duet": PlayOptions,
    "repl": SessionOptions,
    "emulate": EmulationOptions,
}
ELSEWHERE = {"plan": {"draft"}}  # a plan is what a draft goes without


def parameters(name: str) -> dict[str, click.Option]:
    command = group.get_command(click.Context(group), name)
    assert command is not None
    return {one.name: one for one in command.params if isinstance(one, click.Option)}


def declared(declaring: type) -> dict[str, Option]:
    return {one.name: one.metadata["option"] for one in fields(declaring) if one.metadata}


@pytest.mark.parametrize("name", COMMANDS)
def test_declared_options_of_each_command(name):
    shown = parameters(name)
    for field, declaration in declared(COMMANDS[name]).items():
        if field not in ELSEWHERE.get(name, ()):
            assert shown[field].help == declaration.help, field


@pytest.mark.parametrize("name", COMMANDS)
def test_command_and_library_have_the_same_defaults(name):
    shown = parameters(name)
    for field in fields(COMMANDS[name]):
        if field.metadata and field.name in shown:
            context = click.Context(group)
            is_several = shown[field.name].multiple
            default = shown[field.name].get_default(context)
            assert (() if is_several else default) == field.default, field.name


@pytest.mark.parametrize(
    ("accepts", "text", "value"),
    [
        (Integer(1, 9), "9", 9),
        (Number(0, 10, "FORCE"), "200mN", 0.2),
        (Quantities(("MASS",)), "5g", 0.005),
        (Quantities(("FORCE", "SPEED"), "80mN 4mm/s"), "80mN 4mm/s", (0.08, 0.004)),
        (Choice((16, "float")), "16", 16),
        (Choice((16, "float")), "float", "float"),
        (Text(), "A4", "A4"),
    ],
)
def test_declared_option_values_parsed(accepts, text, value):
    options_class = make_dataclass("Own", [("size", object, option(None, "A value.", accepts))])
    command = click.command()(options.from_dataclass(options_class)(lambda size: size))
    read = command(["--size", text], standalone_mode=False)
    assert read == (value if isinstance(value, str) else pytest.approx(value))


def test_options_docstring_describes_each_field():
    said = ergon.RenderOptions.__doc__
    assert "rate: Frames a second of the file [Hz], instead of the score's" in said
