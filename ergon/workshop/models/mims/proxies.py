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
from ergon.workshop.models.mims.model import Model, Point, evaluate_number
from ergon.workshop.models.mims.places import Macro
from ergon.workshop.models.refused import REFUSED

_WORD = re.compile(r"[A-Za-z_]\w*")
_PROBES = (0.0, 1.0, 2.0, 0.3)  # values of a signal at which a place is asked for
_SHARE_TOLERANCE = 1e-12


@dataclass(frozen=True, slots=True)
class Linear:
    """A place or a value: `offset` plus `slope` times a signal; `offset` alone if there is no
    signal.
    """

    signal: str | None
    slope: float
    offset: float


def signals_in(model: Model, text: str) -> list[str]:
    """The parameters in an expression that follow a signal."""
    return [word for word in dict.fromkeys(_WORD.findall(text)) if word in model.signals]


def positions_along(model: Model, point: Point, line: int) -> list[Linear]:
    """The position of a point along each side of its macro. Raises ModelError."""
    return [
        linear_in_signal(model, text, f"the place on {quote(point.name)}", line)
        for text in point.places
    ]


def linear_in_signal(model: Model, text: str, label: str, line: int) -> Linear:
    """An expression as a linear function of its signal. Raises ModelError."""
    signal_names = signals_in(model, text)
    if not signal_names:
        return Linear(None, 0.0, model.number(text, label, line))
    if len(signal_names) > 1:
        raise ModelError(
            REFUSED["two signals"].format(what=label, text=quote(text)),
            line,
        )

    def evaluate_for(value: float) -> float:
        params = {**model.params, signal_names[0]: Amount(Fraction(value), "")}
        return evaluate_number(text, params, label, line)

    value_at_zero, value_at_one, *probed_values = (evaluate_for(value) for value in _PROBES)
    slope = value_at_one - value_at_zero
    expected_values = (value_at_zero + slope * value for value in _PROBES[2:])
    value_pairs = zip(probed_values, expected_values, strict=True)
    if any(
        abs(computed - expected) > _SHARE_TOLERANCE * (1.0 + abs(expected))
        for computed, expected in value_pairs
    ):
        raise ModelError(REFUSED["curved"].format(what=label, text=quote(text)), line)
    return (
        Linear(signal_names[0], slope, value_at_zero) if slope else Linear(None, 0.0, value_at_zero)
    )


def fixed_proxy(shares: Sequence[tuple[float, str]]) -> str:
    """A fixed place between masses, as a module."""
    mass_names = ", ".join(name for _, name in shares)
    share_list = ", ".join(repr(share) for share, _ in shares)
    return f"PROXY: {{of: [{mass_names}], shares: [{share_list}]}}"


def moving_proxy(
    macro: Macro, axis_positions: Sequence[Linear], guide_names: Sequence[str], *, is_2019: bool
) -> str:
    """A point that signals move, as a module; `guide_names` are the MATs whose positions are the
    signals.
    """
    points_per_side = (
        (macro.columns,) if macro.statement.keyword in STRINGS else (macro.rows, macro.columns)
    )
    fields = [f"of: {_masses_by_row(macro)}"]
    if " " in fields[0] and len(points_per_side) > 1:
        fields.append(f"columns: {macro.columns - 2 * _has_rim(macro)}")
    if _has_rim(macro):
        macro.needs_edge = True
        fields.append(f"rim: {macro.edge_name}")
    fields.append(f"follows: {_yaml_list(list(guide_names))}")
    offsets, spans = [], []
    for axis_position, n_points in zip(axis_positions, points_per_side, strict=True):
        # The laws of 2019 take N in place of N - 1, and hold a point beyond the last mass at the
        # last mass.
        scale = (n_points - 1) / n_points if is_2019 else 1.0
        slope = axis_position.slope if axis_position.signal else 1.0
        spans.append(f"{scale / slope!r}m")
        offsets.append(f"{axis_position.offset / slope if axis_position.signal else 0.0!r}m")
    if any(offset != "0.0m" for offset in offsets):
        fields.append(f"offset: {_yaml_list(offsets)}")
    if any(span != "1.0m" for span in spans):
        fields.append(f"span: {_yaml_list(spans)}")
    return f"PROXY: {{{', '.join(fields)}}}"


def _yaml_list(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"[{', '.join(items)}]"


def _has_rim(macro: Macro) -> bool:
    """Whether fixed points surround the moving points, and lie nowhere else."""
    keyword = macro.statement.keyword
    return keyword in ("string", "stiffString") or (keyword == "closedMesh" and macro.rows > 3)


def _masses_by_row(macro: Macro) -> str:
    """The masses, row by row."""
    if macro.statement.keyword in STRINGS or (macro.is_single_generator and macro.rows != 3):
        return macro.name
    if _has_rim(macro):
        return _yaml_list([macro.row_module(row) for row in range(1, macro.rows - 1)])
    members: list[str] = []
    for row_index in range(macro.rows):
        n_fixed, n_moving = macro.moving_columns(row_index)
        fixed_points = [macro.edge_name] * n_fixed
        macro.needs_edge = macro.needs_edge or bool(fixed_points) or not n_moving
        moving_range = macro.member_range(row_index, n_fixed, n_moving) if n_moving else ""
        members += (
            [*fixed_points, moving_range, *fixed_points]
            if n_moving
            else [macro.edge_name] * macro.columns
        )
    return f"[{', '.join(members)}]"
