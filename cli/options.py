"""Options of commands, made from what the library declares, and those that only commands have."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from ergon.api.options import (
    AccuracyOptions,
    FileOptions,
    PerformanceOptions,
    ReadOptions,
    RenderOptions,
)
from ergon.common import option as kinds

from .bundled import ScorePath
from .console import Console

F = TypeVar("F", bound=Callable[..., Any])
_UNIT_AT_END = re.compile(r"\d\s*[^\W\d]+$")  # no exponent: that ends in a digit


def _quantity(
    quantity_text: str, dimension: str, param: click.Parameter | None, ctx: click.Context | None
) -> float:
    """The SI value of a number with a unit. Raises click.BadParameter."""
    from ergon.notation.tables import quantities
    from ergon.notation.text.errors import TextError

    try:
        return quantities.quantity(quantity_text, getattr(quantities, dimension))
    except TextError as error:
        raise click.BadParameter(error.message, ctx, param) from None


class Number(click.FloatRange):
    """A number within bounds, which may have its unit: `48000` and `48kHz` are the same rate.

    NaN, which no comparison finds, is outside of all bounds.
    """

    def __init__(
        self,
        min: float | None = None,
        max: float | None = None,
        dimension: str | None = None,
        *,
        min_open: bool = False,
    ) -> None:
        """`dimension` is one of those in `notation.tables.quantities`; without it no unit may be
        written.
        """
        super().__init__(min, max, min_open=min_open)
        self.dimension = dimension

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number that was written, in SI units. Raises click.BadParameter."""
        if self.dimension is not None and isinstance(value, str) and _UNIT_AT_END.search(value):
            value = _quantity(value, self.dimension, param, ctx)
        try:
            written_number: float = super().convert(value, param, ctx)
        except click.BadParameter as error:
            raise self._with_units(error, param, ctx) from None
        if not math.isfinite(written_number):
            self.fail(f"{value} is not a number that can be used here.", param, ctx)
        return written_number

    def _with_units(
        self, error: click.BadParameter, param: click.Parameter | None, ctx: click.Context | None
    ) -> click.BadParameter:
        """The same mistake, with the units that may be written."""
        if self.dimension is None:
            return error
        from ergon.notation.tables import quantities

        units = ", ".join(getattr(quantities, self.dimension).units)
        message = f"{error.message.rstrip('.')}; without a space, a unit may follow: {units}."
        return click.BadParameter(message, ctx, param)


class Quantity(click.ParamType):  # type: ignore[type-arg] # older clicks' is not generic
    """A number with a unit, as in a score."""

    name = "quantity"

    def __init__(self, dimension: str) -> None:
        """`dimension` is one of the dimensions in `notation.tables.quantities`."""
        self.dimension = dimension

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The SI value."""
        return value if isinstance(value, float) else _quantity(value, self.dimension, param, ctx)


class Quantities(click.ParamType):  # type: ignore[type-arg] # older clicks' is not generic
    """Several numbers with units in one word, separated by spaces."""

    name = "quantities"

    def __init__(self, example: str, *dimensions: str) -> None:
        """`dimensions` are from `notation.tables.quantities`; `example` shows all the numbers."""
        self.example = example
        self.parts = [Quantity(dimension) for dimension in dimensions]

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The SI values."""
        if isinstance(value, tuple):
            return value
        value_words = str(value).split()
        if len(value_words) != len(self.parts):
            self.fail(
                f"'{value}' is not {len(self.parts)} numbers, such as '{self.example}'", param, ctx
            )
        return tuple(
            part.convert(word, param, ctx)
            for part, word in zip(self.parts, value_words, strict=True)
        )


dry_run = click.option(
    "-n", "--dry-run", "dry", is_flag=True, help="Print what would be written; write nothing."
)
score = click.argument("score_path", metavar="SCORE", type=ScorePath())


def several(*options: Callable[[F], F]) -> Callable[[F], F]:
    """Several options as one, shown in this order."""

    def add(command: F) -> F:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def target(help_text: str) -> Callable[[F], F]:
    """The option `-o`, with its help text for this command."""
    return click.option("-o", "--output", metavar="FILE", help=help_text)


def strict(failure: str, code: int = 1) -> Callable[[F], F]:
    """The option `--strict`: what else is a warning ends the command with an exit code."""
    help_text = f"Make a warning a failure: exit with code {code} {failure}."
    return click.option("--strict", is_flag=True, help=help_text)


def with_console(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --json, -q and -v, and hand the command a Console as its first argument."""

    @click.option("--json", "as_json", is_flag=True, help="Write JSON lines to stdout.")
    @click.option("-q", "--quiet", is_flag=True, help="Print errors only.")
    @click.option("-v", "--verbose", is_flag=True, help="Print more messages.")
    @functools.wraps(command)
    def with_console_first(
        *args: Any, as_json: bool, quiet: bool, verbose: bool, **options: Any
    ) -> Any:
        console = Console(json=as_json, quiet=quiet, verbose=verbose)
        return command(console, *args, **options)

    return with_console_first


def from_dataclass(option_class: Any, option_names: str = "") -> Callable[[F], F]:
    """Options of a command from fields of a dataclass of options: from those in `option_names`, in
    that order, or from all.
    """
    fields = {field.name: field for field in dataclasses.fields(option_class)}
    return several(*(_option(fields[name]) for name in option_names.split() or fields))


def _option(option_field: dataclasses.Field[Any]) -> Callable[[F], F]:
    option_kind: kinds.Option = option_field.metadata["option"]
    flag = f"--{option_field.name.strip('_').replace('_', '-')}"
    flag_words = (_SHORT_FLAGS[flag], flag) if flag in _SHORT_FLAGS else (flag,)
    click_arguments: dict[str, Any] = {}
    match option_kind.accepts:
        case kinds.Switch():
            flag_words = (f"{flag}/--no{flag[1:]}",)
        case kinds.Text(if_alone=str() as value):
            click_arguments = {"is_flag": False, "flag_value": value}
        case kinds.Choice(values=values):
            value_by_text = {str(value): value for value in values}
            click_arguments = {
                "callback": lambda _context, _parameter, text: value_by_text.get(text, text)
            }
    if option_field.default is False:
        click_arguments["is_flag"] = True
    else:
        is_several = option_field.default == ()
        default = None if is_several else option_field.default
        click_arguments |= {
            "multiple": is_several,
            "default": default,
            "type": _type(option_kind.accepts),
        }
        click_arguments |= {"metavar": option_kind.metavar, "show_default": option_kind.shown}
        click_arguments["required"] = option_kind.is_required
    return click.option(*flag_words, option_field.name, help=option_kind.help, **click_arguments)


_SHORT_FLAGS = {"--force": "-f"}


def _type(accepts: kinds.Accepted) -> click.ParamType | None:  # type: ignore[type-arg] # older clicks' is not generic
    match accepts:
        case kinds.Integer(low=None, high=None):
            return click.INT
        case kinds.Integer(low=low, high=high):
            return click.IntRange(low, high)
        case kinds.Number():
            return Number(accepts.low, accepts.high, accepts.dimension, min_open=accepts.is_open)
        case kinds.Choice(values=values):
            return click.Choice([str(value) for value in values])
        case kinds.Path(kind=kind, must_exist=must_exist):
            is_file = kind == "file"
            return click.Path(
                exists=must_exist, file_okay=is_file, dir_okay=not is_file, path_type=Path
            )
        case kinds.Quantities(dimensions=(dimension,)):
            return Quantity(dimension)
        case kinds.Quantities(dimensions=dimensions, example=example):
            return Quantities(example, *dimensions)
    return None


trust = from_dataclass(ReadOptions, "trust")
seed = from_dataclass(AccuracyOptions, "seed")
accuracy = from_dataclass(AccuracyOptions, "method error cents plan")
draft = from_dataclass(AccuracyOptions, "draft")
on = from_dataclass(RenderOptions, "on")
bits = from_dataclass(RenderOptions, "bits")
force = from_dataclass(FileOptions, "force")
view_at = from_dataclass(PerformanceOptions, "view_at")
# Sound output of a performance.
sound = from_dataclass(PerformanceOptions, "audio audio_in block ahead gain to head")
# Real hands of a performance, and limits that protect them.
hands = from_dataclass(PerformanceOptions, "live drive unchecked force_max")
