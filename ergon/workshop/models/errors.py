"""The refusal of a model: a sentence with the line of the model."""

from __future__ import annotations

from ergon.common.errors import ErgonError
from ergon.common.terminal import printable


class ModelError(ErgonError, ValueError):
    """A model that cannot be read, or that no score can express; `line` counts from 1, 0 is the
    file.
    """

    def __init__(self, message: str, line: int = 0, suggestion: str | None = None) -> None:
        """`suggestion`: the known word that was most likely meant."""
        self.message, self.line, self.suggestion = message, line, suggestion
        self.file = ""
        super().__init__(message)

    def __str__(self) -> str:
        """`model.mdl:12: …; did you mean 'spring'?`."""
        prefix = f"{self.file}:{self.line}: " if self.line else f"{self.file}: "
        suggestion_text = f"; did you mean {self.suggestion!r}?" if self.suggestion else ""
        return printable(f"{prefix if self.file else ''}{self.message}{suggestion_text}")


class DialectError(ModelError):
    """A model that both dialects can read, with a different sound in each."""
