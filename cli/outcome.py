"""How a command ends: one exception per exit code, so that no command calls `sys.exit`."""

from __future__ import annotations

from typing import ClassVar

from ergon.common.errors import ErgonError


class Outcome(ErgonError):
    """A command's early end with a sentence for the person who typed it."""

    exit_code: ClassVar[int] = 2

    def __init__(self, message: str = "", *, code: str = "", **error_place: object) -> None:
        """`code` and `error_place` (file, line, column, suggestion) go into the JSON record."""
        super().__init__(message)
        self.message = message
        self.code = code
        self.place = error_place


class Findings(Outcome):
    """The score has errors; the message is empty if they were printed already."""

    exit_code = 1


class Refused(Outcome):
    """Wrong usage, or something that ergon will not do."""

    exit_code = 2


class DeviceMissing(Outcome):
    """No audio or haptic device where one was asked for."""

    exit_code = 3


class Diverged(Outcome):
    """The simulation went non-finite."""

    exit_code = 4


class Late(Outcome):
    """Too many late blocks under --strict."""

    exit_code = 5


def check_stdout(output: str | None, *, is_json: bool) -> None:
    """Refuse to write both a file and records to stdout. Raises Refused."""
    if output == "-" and is_json:
        raise Refused("--json and -o - both write to stdout; give one")


INTERRUPTED = 130  # 128 + SIGINT, as shells have it
INTERNAL = 2
EXIT_CODES = (
    (0, "done"),
    (Findings.exit_code, "errors in the score; with --strict also warnings"),
    (Refused.exit_code, "wrong usage, a file refused, or an internal error"),
    (DeviceMissing.exit_code, "device missing"),
    (Diverged.exit_code, "the simulation diverged"),
    (Late.exit_code, "too many late blocks (--strict)"),
    (INTERRUPTED, "Ctrl-C"),
)
