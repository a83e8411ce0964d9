"""Generates the source of a law's loops, for numba, from the rows that the core makes of the law.

A law without exp, tanh, noise and powers is one loop over all links. Others are computed in
chunks: a loop up to a function, the core's function over the chunk, the next loop. Values that
cross loops are kept in the array `room`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

Row = tuple[str, int, int, int]  # operation, operands: 0 is d, 1 is v, 2 + i what row i gives
_FIRST_REGISTER = 2
_LANES = 64  # the core's NATIVE_LANES
_OPERATION_FORMATS = {
    "copy": "{0}",
    "negate": "-{0}",
    "abs": "abs({0})",
    "sqrt": "sqrt({0})",
    "sign": "1.0 if {0} > 0.0 else (-1.0 if {0} < 0.0 else {0})",
    "add": "{0} + {1}",
    "subtract": "{0} - {1}",
    "multiply": "{0} * {1}",
    "divide": "{0} / {1}",
    "min": "{1} if {1} < {0} else {0}",
    "max": "{1} if {1} > {0} else {0}",
    "less": "1.0 if {0} < {1} else 0.0",
    "less_equal": "1.0 if {0} <= {1} else 0.0",
    "greater": "1.0 if {0} > {1} else 0.0",
    "greater_equal": "1.0 if {0} >= {1} else 0.0",
    "equal": "1.0 if {0} == {1} else 0.0",
    "not_equal": "1.0 if {0} != {1} else 0.0",
    "where": "{1} if {0} != 0.0 else {2}",
}
# Functions of the core with their number of operands; `SLOW` ones work link by link.
_FUNCTION_OPERANDS = {"exp": 1, "tanh": 1, "noise": 1, "power": 2}
LINKWISE_FUNCTIONS = {"tanh", "noise", "power"}


def source(rows: Sequence[Row]) -> str:
    """Python text of `law(d, v, out, numbers, room, n)`: the forces of n links."""
    return "\n".join(_Writer(rows).lines())


def _operands(row: Row) -> tuple[int, ...]:
    operation_name, *operands = row
    if operation_name == "constant":
        return ()
    if operation_name == "whole_power":
        return (operands[0],)
    operation_text = _OPERATION_FORMATS.get(operation_name, "")
    return tuple(
        operands[
            : _FUNCTION_OPERANDS.get(
                operation_name,
                3 if "{2}" in operation_text else 2 if "{1}" in operation_text else 1,
            )
        ]
    )


@dataclass(slots=True)
class _Writer:
    rows: Sequence[Row]
    loop_of_row: list[int] = field(default_factory=list)  # for each row, the loop that computes it

    def __post_init__(self) -> None:
        for row in self.rows:
            # The result of a function can be read only in a later loop.
            operand_rows = [
                register - _FIRST_REGISTER
                for register in _operands(row)
                if register >= _FIRST_REGISTER
            ]
            later_loops = (
                self.loop_of_row[i] + (self.rows[i][0] in _FUNCTION_OPERANDS) for i in operand_rows
            )
            self.loop_of_row.append(max(later_loops, default=0))

    def lines(self) -> Iterator[str]:
        n_numbers = sum(row[0] == "constant" for row in self.rows)
        yield "def law(d, v, out, numbers, room, n):"
        yield from (f"    c{i} = numbers[{i}]" for i in range(n_numbers))
        if not any(row[0] in _FUNCTION_OPERANDS for row in self.rows):
            yield "    for i in range(n):"
            yield from (f"        {line}" for line in self._loop_lines(0, "i"))
            return
        yield f"    for first in range(0, n, {_LANES}):"
        yield f"        m = min({_LANES}, n - first)"
        for stage in range(max(self.loop_of_row) + 1):
            if loop_lines := list(self._loop_lines(stage, "first + i")):
                yield "        for i in range(m):"
                yield from (f"            {line}" for line in loop_lines)
            yield from (f"        {call}" for call in self._function_calls(stage))

    def _loop_lines(self, stage: int, link: str) -> Iterator[str]:
        loaded_operands: set[int] = set()
        for row_index, law_row in enumerate(self.rows):
            if (
                self.loop_of_row[row_index] != stage
                or law_row[0] in _FUNCTION_OPERANDS
                or law_row[0] == "constant"
            ):
                continue
            for operand in _operands(law_row):
                if (
                    self._is_computed(operand)
                    and operand not in loaded_operands
                    and self._comes_from_room(operand, stage)
                ):
                    yield f"r{operand} = room[{_room_index(operand)} + i]"
                    loaded_operands.add(operand)
            operand_names = [self._name(operand, link) for operand in _operands(law_row)]
            if law_row[0] == "whole_power":
                yield from _integer_power(
                    f"r{_FIRST_REGISTER + row_index}", operand_names[0], law_row[2]
                )
            else:
                operation_text = _OPERATION_FORMATS[law_row[0]].format(*operand_names)
                yield f"r{_FIRST_REGISTER + row_index} = {operation_text}"
        for operand in sorted(self._operands_in_room(stage)):
            yield f"room[{_room_index(operand)} + i] = {self._name(operand, link)}"
        if self.loop_of_row[-1] == stage:
            yield f"out[{link}] = r{_FIRST_REGISTER + len(self.rows) - 1}"

    def _function_calls(self, stage: int) -> Iterator[str]:
        for i, (operation_name, a, b, _) in enumerate(self.rows):
            if self.loop_of_row[i] == stage and operation_name in _FUNCTION_OPERANDS:
                places = ", ".join(str(_room_index(at)) for at in (a, b, _FIRST_REGISTER + i))
                yield f"{operation_name}(room, {places}, m)"

    def _operands_in_room(self, stage: int) -> set[int]:
        """Operands that `room` must hold after a loop, because a function or a later loop reads
        them.
        """
        operands = set()
        for i, row in enumerate(self.rows):
            is_call = row[0] in _FUNCTION_OPERANDS
            for operand in _operands(row):
                if not self._is_computed(operand):
                    is_read = is_call and self.loop_of_row[i] == stage
                else:
                    is_local = self.loop_of_row[
                        operand - _FIRST_REGISTER
                    ] == stage and not self._is_call(operand)
                    is_read = is_local and (is_call or self.loop_of_row[i] > stage)
                if is_read:
                    operands.add(operand)
        return operands

    def _is_computed(self, operand: int) -> bool:
        return operand >= _FIRST_REGISTER and self.rows[operand - _FIRST_REGISTER][0] != "constant"

    def _is_call(self, operand: int) -> bool:
        return self.rows[operand - _FIRST_REGISTER][0] in _FUNCTION_OPERANDS

    def _comes_from_room(self, operand: int, stage: int) -> bool:
        return self._is_call(operand) or self.loop_of_row[operand - _FIRST_REGISTER] < stage

    def _name(self, operand: int, link: str) -> str:
        if operand < _FIRST_REGISTER:
            return f"{'dv'[operand]}[{link}]"
        row = self.rows[operand - _FIRST_REGISTER]
        return f"c{row[1]}" if row[0] == "constant" else f"r{operand}"


def _room_index(operand: int) -> int:
    """The index in `room` of a chunk of an operand."""
    return _LANES * operand


def _integer_power(result_name: str, base_name: str, exponent: int) -> Iterator[str]:
    """Exponentiation by squaring from the highest bit down, as in the core."""
    size = abs(exponent)
    yield f"{result_name} = {base_name if size else 1.0}"
    for bit in bin(size)[3:]:
        yield f"{result_name} = {result_name} * {result_name}"
        if bit == "1":
            yield f"{result_name} = {result_name} * {base_name}"
    if exponent < 0:
        yield f"{result_name} = 1.0 / {result_name}"
