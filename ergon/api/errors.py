"""Errors of the library; `ErgonError` is the root of all that ergon raises."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ergon.common.errors import ErgonError

if TYPE_CHECKING:
    from ergon import _core
    from ergon.notation.text.errors import Diagnostic, Source


class ScoreError(ErgonError):
    """The score has mistakes, or the engine cannot play it.

    `diagnostics` are all that was found, warnings too, each with its place. The message shows the
    errors among them, a line each.
    """

    def __init__(
        self,
        diagnostics: Sequence[Diagnostic],
        sources: Mapping[str, Source] | None = None,
        *,
        reason: str = "",
    ) -> None:
        """`sources`: texts of the files, by name; `reason`: a sentence without a place."""
        self.diagnostics = tuple(diagnostics)
        self.reason = reason
        self._sources = sources or {}
        super().__init__(self.diagnostics)

    def __str__(self) -> str:
        """One line an error: `score.yaml:3:9: error[E204]: …`."""
        from ergon.notation.text.errors import RENDERERS

        if self.reason:
            return self.reason
        errors = [diagnostic for diagnostic in self.diagnostics if diagnostic.severity == "error"]
        return "\n".join(
            RENDERERS["concise"](diagnostic, self._sources).rstrip() for diagnostic in errors
        )


class DivergedError(ScoreError):
    """A part of the score reached a value that is not finite; its diagnostic names the part."""


class OptionError(ErgonError):
    """An option has a value that it cannot have, or one that another option excludes.

    `option` is the name of the option (`"gain"`), `reason` the sentence without that name,
    `value` the text of the value at fault if an option has several.
    """

    def __init__(
        self,
        option: str,
        reason: str,
        *,
        value: str | None = None,
        excludes: str | None = None,
    ) -> None:
        """`reason` says what is wrong with `option`, or, if it `excludes` another option, what to
        do.
        """
        self.option, self.value, self.excludes = option, value, excludes
        self._reason_after_flag = reason
        self.reason = reason if excludes is None else f"excludes {excludes}{reason}"
        super().__init__(f"{option}{'' if value is None else f'={value!r}'}: {self.reason}")

    @property
    def on_command_line(self) -> str:
        """The message with the option as the command line writes it: `--gain: …`."""
        flag_name, flag_reason = _command_line_flag(self.option), self.reason
        if self.excludes is not None:
            flag_reason = f"excludes {_command_line_flag(self.excludes)}{self._reason_after_flag}"
        return f"{flag_name}{'' if self.value is None else f' {self.value}'}: {flag_reason}"


def _command_line_flag(option: str) -> str:
    return f"--{option.strip('_').replace('_', '-')}"


class EngineExitError(ErgonError):
    """The process of a session ended before it answered, with the code `exit_code`."""

    def __init__(self, exit_code: int) -> None:
        """`exit_code` is the code of the process, whose messages stand on stderr."""
        super().__init__(f"the engine of the session ended with exit code {exit_code}")
        self.exit_code = exit_code


class DeviceError(ErgonError):
    """A sound card or a force-feedback device is not there, or does not answer."""


def not_started_error(error: _core.EngineError, sentence: str) -> ErgonError:
    """The error for a performance that could not start: of its recording's file, or of a device."""
    from ergon.exchange.safe import FileRefusedError

    is_recording_error = error.module == "record"
    return FileRefusedError(sentence) if is_recording_error else DeviceError(sentence)
