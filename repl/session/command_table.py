"""The table of commands that make no new version: for each, the function that does it.

A module adds its functions by a decorator; `session_commands` imports all such modules.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from ergon.repl.language.commands import Command

if TYPE_CHECKING:
    from ergon.repl.session.core import SessionCore
    from ergon.repl.session_protocol import Reply

_CommandFunction = TypeVar("_CommandFunction", bound="Callable[..., Reply]")

# A new verb needs a row in `language/verbs`, its values, and a function here or in `edit_table`.
SESSION_COMMANDS: dict[type[Command], Callable[[SessionCore, Any], Reply]] = {}


def executes(command_type: type[Command]) -> Callable[[_CommandFunction], _CommandFunction]:
    """Decorate the function that does a command."""

    def register(function: _CommandFunction) -> _CommandFunction:
        SESSION_COMMANDS[command_type] = function
        return function

    return register
