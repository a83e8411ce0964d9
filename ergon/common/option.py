"""Options of a call, declared once: their defaults, what they mean, and what they accept.

The command line makes its own options from these declarations, and documentation its lines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import wraps
from typing import Any, Literal, TypeVar
from warnings import warn

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Integer:
    """A whole number within bounds."""

    low: int | None = None
    high: int | None = None


@dataclass(frozen=True, slots=True)
class Number:
    """A number within bounds; one with a dimension of `notation.tables.quantities` may have a
    unit. With `is_open` it is above `low`.
    """

    low: float | None = None
    high: float | None = None
    dimension: str | None = None
    is_open: bool = False


@dataclass(frozen=True, slots=True)
class Quantities:
    """Numbers that need their units, as in a score; several in one word, such as `example`."""

    dimensions: tuple[str, ...]
    example: str = ""


@dataclass(frozen=True, slots=True)
class Choice:
    """One of some values."""

    values: tuple[int | str, ...]


@dataclass(frozen=True, slots=True)
class Path:
    """A path; an existing one must be what it says."""

    kind: Literal["file", "folder"]
    must_exist: bool = False


@dataclass(frozen=True, slots=True)
class Switch:
    """Yes or no, where the default is another."""


@dataclass(frozen=True, slots=True)
class Text:
    """Any text; the option alone means `if_alone`, if that is a text."""

    if_alone: str | None = None


Accepted = Integer | Number | Quantities | Choice | Path | Switch | Text


@dataclass(frozen=True, slots=True)
class Option:
    """What a field of options means, and what it accepts.

    `metavar` names the value in help. The default is shown there as `shown`. The command line
    demands a required one.
    """

    help: str
    accepts: Accepted = Text()
    metavar: str | None = None
    shown: str | bool = False
    is_required: bool = False


def option(
    default: Any,
    help: str,
    accepts: Accepted = Text(),
    *,
    metavar: str | None = None,
    shown: str | bool = False,
    is_required: bool = False,
) -> Any:
    """A field of a dataclass of options.

    One whose default is False is a flag, one whose default is empty may be given several times.
    """
    option_declaration = Option(help, accepts, metavar, shown, is_required)
    return field(default=default, metadata={"option": option_declaration})


def documented(option_class: type[T]) -> type[T]:
    """The class, with what its fields mean behind its docstring."""
    all_fields = fields(option_class)  # type: ignore[arg-type]
    new_fields = [field for field in all_fields if field.name in option_class.__annotations__]
    field_lines = [
        f"    {field.name}: {field.metadata['option'].help}"
        for field in new_fields
        if field.metadata
    ]
    option_class.__doc__ = "\n".join([f"{option_class.__doc__}", *field_lines])
    return option_class


def renamed(**new_names: str) -> Callable[[type[T]], type[T]]:
    """A decorator of a dataclass that still takes fields by earlier names, with a warning.

    Each earlier name is given with the present one: `@renamed(to="until")`.
    """

    def decorate(option_class: type[T]) -> type[T]:
        construct = option_class.__init__

        @wraps(construct)
        def constructed(self: T, *values: Any, **keywords: Any) -> None:
            for earlier_name, present_name in new_names.items():
                if earlier_name in keywords and present_name not in keywords:
                    message = (
                        f"{option_class.__name__}: `{earlier_name}` is called `{present_name}` now"
                    )
                    warn(message, DeprecationWarning, stacklevel=2)
                    keywords[present_name] = keywords.pop(earlier_name)
            construct(self, *values, **keywords)

        setattr(option_class, "__init__", constructed)  # noqa: B010
        return option_class

    return decorate
