"""Options reach the functions of their commands: click passes them by name."""

import importlib
import inspect
import pkgutil
from collections.abc import Iterator

import click

import ergon.cli

SHARED = {"as_json", "quiet", "verbose", "debug", "version"}  # a decorator takes these


def _commands() -> Iterator[click.Command]:
    waiting = [
        value
        for module in pkgutil.iter_modules(ergon.cli.__path__)
        for value in vars(importlib.import_module(f"ergon.cli.{module.name}")).values()
        if isinstance(value, click.Command)
    ]
    while waiting:
        command = waiting.pop()
        yield command
        if isinstance(command, click.Group):
            waiting.extend(command.commands.values())


def test_command_options_are_parameters_of_its_function():
    checked = 0
    for command in _commands():
        if command.callback is None:
            continue
        parameters = inspect.signature(inspect.unwrap(command.callback)).parameters.values()
        names = {parameter.name for parameter in parameters}
        options = {option.name for option in command.params} - SHARED
        is_open = any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)
        assert is_open or options <= names, f"{command.name}: {options - names}"
        checked += 1
    assert checked > 40
