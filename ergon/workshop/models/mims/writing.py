"""A score in the making: what has been written of a model so far."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims import places
from ergon.workshop.models.mims.functions import is_score_expression
from ergon.workshop.models.mims.kicks import InitialMotion
from ergon.workshop.models.mims.laws import Laws
from ergon.workshop.models.mims.model import Model, Statement
from ergon.workshop.models.mims.proxies import signals_in
from ergon.workshop.models.naming import Names, Params, is_read_alike
from ergon.workshop.models.page import Input, Line, Output
from ergon.workshop.models.refused import REFUSED

_WORD = re.compile(r"[A-Za-z_]\w*")


@dataclass(slots=True)
class ScoreDraft:
    """A score in the making; `model` has its signals at their first values."""

    model: Model
    laws: Laws
    inputs: Mapping[str, Input]
    params: Params
    names: Names = field(default_factory=Names)
    modules: list[Line] = field(default_factory=list)
    mass_modules: dict[str, str] = field(default_factory=dict)  # modules of masses
    macros: dict[str, places.Macro] = field(default_factory=dict)
    links: list[tuple[Statement, str]] = field(default_factory=list)  # with the module's name
    outputs: list[Output] = field(default_factory=list)
    initial_motions: dict[str, InitialMotion] = field(
        default_factory=dict
    )  # starts of masses and inputs
    immobile: set[str] = field(default_factory=set)  # points that no force moves
    initial_forces: dict[str, float] = field(default_factory=dict)  # forces in the first sample
    proxies: dict[tuple[object, ...], str] = field(
        default_factory=dict
    )  # proxies by their position
    guides: dict[str, str] = field(default_factory=dict)  # points that have the value of a signal
    takes_ahead: dict[str, str] = field(default_factory=dict)  # takes by the inputs that they lead
    takes: dict[str, Input] = field(default_factory=dict)  # beside those of inputs

    def add(self, name: str, text: str, comment: str = "") -> None:
        """Add a module."""
        self.modules.append(Line(name, f"{{{text}}}", comment))

    def text(self, statement: Statement, name: str, default: str = "0") -> str:
        """A value as an expression of the score."""
        text = statement.values.get(name, default)
        for signal in signals_in(self.model, text):
            message = REFUSED["signal"].format(name=quote(signal), value=name)
            raise ModelError(message, statement.line)
        score_text = self.params.translated(text)
        has_names = any(word in self.model.params for word in _WORD.findall(text))
        if not is_score_expression(text, self.model.params) or not (
            has_names or is_read_alike(score_text)
        ):
            label = f"{name} of {quote(statement.name)}"
            return repr(self.model.number(text, label, statement.line))
        return score_text

    def value(self, statement: Statement, name: str, default: float = 0.0) -> float:
        """A value as a number."""
        self.text(statement, name)
        return self.model.value(statement, name, default)
