"""Points between masses of a macro as PROXY, at a place or moved by a signal."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from ergon.notation.tables.expressions import Amount
from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.grammar import STRINGS
from ergon.workshop.models.mims.model import Model, Point, number
from ergon.workshop.models.mims.places import Macro
from ergon.workshop.models.refused import REFUSED

_WORD = re.compile(r"[A-Za-z_]\w*")
_PROBES = (0.0, 1.0, 2.0, 0.3)  # values of a signal at which a place is asked for
_SHARE_TOLERANCE = 1e-12


@dataclass(frozen=True, slots=True)
class Along:
    """A place or a value: `start` plus `slope` times a signal; `start` alone if there is no
    signal.
    """

    signal: str | None
    slope: float
    start: float


def signals_in(model: Model, text: str) -> list[str]:
    """The parameters in an expression that follow a signal."""
    return [word for word in dict.fromkeys(_WORD.findall(text)) if word in model.signals]


def along(model: Model, point: Point, line: int) -> list[Along]:
    """The position of a point along each side of its macro. Raises ModelError."""
    return [
        straight(model, text, f"the place on {quote(point.name)}", line) for text in point.along
    ]


def straight(model: Model, text: str, label: str, line: int) -> Along:
    """An expression as a linear function of its signal. Raises ModelError."""
    signal_names = signals_in(model, text)
    if not signal_names:
        return Along(None, 0.0, model.number(text, label, line))
    if len(signal_names) > 1:
        raise ModelError(
            REFUSED["two signals"].format(what=label, text=quote(text)),
            line,
        )

    def number_for(value: float) -> float:
        params = {**model.params, signal_names[0]: Amount(Fraction(value), "")}
        return number(text, params, label, line)

    value_at_zero, value_at_one, *probed_values = (number_for(value) for value in _PROBES)
    slope = value_at_one - value_at_zero
    expected_values = (value_at_zero + slope * value for value in _PROBES[2:])
    value_pairs = zip(probed_values, expected_values, strict=True)
    if any(
        abs(computed - expected) > _SHARE_TOLERANCE * (1.0 + abs(expected))
        for computed, expected in value_pairs
    ):
        raise ModelError(REFUSED["curved"].format(what=label, text=quote(text)), line)
    return (
        Along(signal_names[0], slope, value_at_zero) if slope else Along(None, 0.0, value_at_zero)
    )


def between_masses(shares: Sequence[tuple[float, str]]) -> str:
    """A fixed place between masses, as a module."""
    mass_names = ", ".join(name for _, name in shares)
    share_list = ", ".join(repr(share) for share, _ in shares)
    return f"PROXY: {{of: [{mass_names}], shares: [{share_list}]}}"


def moving(macro: Macro, sides: Sequence[Along], guides: Sequence[str], *, is_2019: bool) -> str:
    """A point that signals move, as a module; `guides` are the MATs whose positions are the
    signals.
    """
    side_counts = (
        (macro.columns,) if macro.statement.keyword in STRINGS else (macro.rows, macro.columns)
    )
    written_fields = [f"of: {_row(macro)}"]
    if " " in written_fields[0] and len(side_counts) > 1:
        written_fields.append(f"columns: {macro.columns - 2 * _has_rim(macro)}")
    if _has_rim(macro):
        macro.is_joined = True
        written_fields.append(f"rim: {macro.edge}")
    written_fields.append(f"follows: {_list(list(guides))}")
    side_offsets, side_spans = [], []
    for macro_side, side_count in zip(sides, side_counts, strict=True):
        # The laws of 2019 take N in place of N - 1, and hold a point beyond the last mass at the
        # last mass.
        reach = (side_count - 1) / side_count if is_2019 else 1.0
        slope = macro_side.slope if macro_side.signal else 1.0
        side_spans.append(f"{reach / slope!r}m")
        side_offsets.append(f"{macro_side.start / slope if macro_side.signal else 0.0!r}m")
    if any(offset != "0.0m" for offset in side_offsets):
        written_fields.append(f"offset: {_list(side_offsets)}")
    if any(span != "1.0m" for span in side_spans):
        written_fields.append(f"span: {_list(side_spans)}")
    return f"PROXY: {{{', '.join(written_fields)}}}"


def _list(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"[{', '.join(items)}]"


def _has_rim(macro: Macro) -> bool:
    """Whether fixed points surround the moving points, and lie nowhere else."""
    keyword = macro.statement.keyword
    return keyword in ("string", "stiffString") or (keyword == "closedMesh" and macro.rows > 3)


def _row(macro: Macro) -> str:
    """The masses, row by row."""
    if macro.statement.keyword in STRINGS or (macro.is_whole and macro.rows != 3):
        return macro.name
    if _has_rim(macro):
        return _list([macro.row(row) for row in range(1, macro.rows - 1)])
    row_members: list[str] = []
    for row_index in range(macro.rows):
        first_moving, moving_count = macro.span(row_index)
        fixed_points = [macro.edge] * first_moving
        macro.is_joined = macro.is_joined or bool(fixed_points) or not moving_count
        moving_members = macro.member(row_index, first_moving, moving_count) if moving_count else ""
        row_members += (
            [*fixed_points, moving_members, *fixed_points]
            if moving_count
            else [macro.edge] * macro.columns
        )
    return f"[{', '.join(row_members)}]"
