"""Groups of commands, each imported when it is called."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any, NamedTuple

import click

from . import examples, habits, renamed

# name → (module, attribute, one line of help), or the help alone if module and attribute have the
# same name as the command. The help is in the table so that `--help` imports no command.
Table = Mapping[str, str | tuple[str, str, str]]
ROOT = "ergon"  # the name of the group of all commands
_HELP_ADVICE = "`ergon help` lists all commands"


class CommandEntry(NamedTuple):
    """The module of a command, its attribute there, and its line of help."""

    module: str
    attribute: str
    help_line: str


def command_entry(table: Table, name: str) -> CommandEntry:
    """The entry of a command in a table."""
    entry = table[name]
    return CommandEntry(name, name, entry) if isinstance(entry, str) else CommandEntry(*entry)


class LazyGroup(click.Group):
    """A group whose commands are known by name and imported only when used."""

    def __init__(
        self,
        *args: Any,
        table: Table,
        sections: Mapping[str, tuple[str, ...]] | None = None,
        **group_options: Any,
    ) -> None:
        """`table` lists the commands; `sections` are the headings of `--help`, each with its
        commands in order. Without any they are listed under one heading, in the order of the table.
        """
        super().__init__(*args, **group_options)
        self.table = table
        self.sections = sections or {"Commands": tuple(table)}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All names, in the order of `--help`."""
        return [name for names in self.sections.values() for name in names]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command; None when there is no such name."""
        if cmd_name not in self.table:
            return None
        entry = command_entry(self.table, cmd_name)
        command = getattr(import_module(f"ergon.cli.{entry.module}"), entry.attribute)
        assert isinstance(command, click.Command)
        if command.epilog is None:
            command.epilog = examples.section(self.path_of(cmd_name))
        return command

    def path_of(self, name: str) -> str:
        """A command with the groups before it, without `ergon`: `render`, `take trim`."""
        return name if self.name == ROOT else f"{self.name} {name}"

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the options before a command. An option that belongs after the command is refused
        with the right order.
        """
        if (
            self.name == ROOT
            and args[:1] in (["-h"], ["--help"])
            and args[1:2]
            and (args[1] in self.table)
        ):
            args = [*args[1:], args[0]]  # `ergon --help render`
        argument_words = list(args)
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            if self.name != ROOT:
                raise
            message = self._misplaced_option_message(argument_words, error)
            raise click.UsageError(message, ctx) from None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Resolve a command as click does, with the nearest name in the message (in all versions of
        click), or what to type instead.
        """
        command_name = args[0]
        if command_name not in self.table and not command_name.startswith("-"):
            raise click.UsageError(self._unknown_command_message(args), ctx)
        resolved_name, command, command_words = super().resolve_command(ctx, args)
        if command is not None and not isinstance(command, click.Group):
            names = (word for option in command.params for word in option.opts)
            if option_meant := habits.long_option_meant(command_words, names):
                raise click.UsageError(
                    f"{option_meant[1:]} is written with two dashes: {option_meant}", ctx
                )
            command_words = renamed.respelt(self.path_of(command_name), command_words)
        return resolved_name, command, command_words

    def _misplaced_option_message(self, command_words: list[str], error: click.NoSuchOption) -> str:
        if line := habits.reordered(command_words, self.table):
            return f"the command comes first: {line}"
        if advised_line := habits.instead(command_words[:1]):
            return f"No such option '{command_words[0]}'. Use: {advised_line}"
        if command_words[0] in habits.BEHIND:
            return (
                f"{command_words[0]} follows a command, such as: ergon check piece.yaml "
                f"{command_words[0]}"
            )
        return f"{error.format_message()} {_HELP_ADVICE}."

    def _unknown_command_message(self, args: list[str]) -> str:
        from ergon.notation.text.spelling import nearest

        from . import manual

        command_name = args[0]
        is_root = self.name == ROOT
        if is_root and command_name.endswith((".yaml", ".yml")):
            line = habits.reordered(args, self.table) or " ".join(["ergon render", *args])
            return f"a command comes first: {line}"
        error_sentence = f"No such command '{command_name}'."
        if is_root and (advised_line := habits.instead(args)):
            return f"{error_sentence} Use: {advised_line}"
        if not is_root and self.invoke_without_command and command_name in habits.LISTING:
            return f"{error_sentence} Use: {ROOT} {self.name}"
        if suggestion := nearest(command_name, self.table):
            return f"{error_sentence} Did you mean '{suggestion}'?"
        if not is_root:
            return f"{error_sentence} `ergon {self.name} -h` lists the commands."
        if manual.matches(command_name, manual.pages()):
            return (
                f"{error_sentence} `ergon help {command_name}` opens a page about it; "
                f"{_HELP_ADVICE}."
            )
        return f"{error_sentence} {_HELP_ADVICE}."

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands in `--help`, from the table alone."""
        name_width = max(len(name) for name in self.table)
        for title, command_names in self.sections.items():
            with formatter.section(title):
                formatter.write_dl(
                    [
                        (f"{name:{name_width}}", command_entry(self.table, name).help_line)
                        for name in command_names
                    ]
                )
