"""Groups of commands, each imported when it is called."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import click

# name → (module, attribute, one line of help). The help is in the table so that `--help` imports no
# command.
Table = Mapping[str, tuple[str, str, str]]


class LazyGroup(click.Group):
    """A group whose commands are known by name and imported only when used."""

    def __init__(self, *args: Any, table: Table, **options: Any) -> None:
        """`table` lists the commands in the order of `--help`."""
        super().__init__(*args, **options)
        self.table = table

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All names, in the order of the table."""
        return list(self.table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command; None when there is no such name."""
        if cmd_name not in self.table:
            return None
        module, attribute, _ = self.table[cmd_name]
        command = getattr(import_module(f"ergon.cli.{module}"), attribute)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Resolve a command as click does, with the nearest name in the message (in all versions of
        click).
        """
        name = args[0]
        if name not in self.table and not name.startswith("-"):
            if ctx.parent is None and name.endswith((".yaml", ".yml")):
                raise click.UsageError(f"a command comes first: ergon render {name}", ctx)
            from ergon.notation.text.spelling import nearest

            close = nearest(name, self.table)
            asked = f" Did you mean '{close}'?" if close else ""
            raise click.UsageError(f"No such command '{name}'.{asked}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands in `--help`, from the table alone."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, _, text) in self.table.items()])
