"""Conditions: values compared, such as `i < 12 and i mod 2 == 0`, joined by `and`, `or`, `not`."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from itertools import pairwise

from ergon.notation.tables.expressions import Amount, evaluate, unit_in_words
from ergon.notation.text.errors import TextError, quote

_OR, _AND = re.compile(r"\bor\b"), re.compile(r"\band\b")
_NOT = re.compile(r"\s*not\b")
_SIGN = re.compile(r"<=|>=|==|!=|<|>|=")
_COMPARISONS: Mapping[str, Callable[[Fraction, Fraction], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


def is_true(written_text: str, text_start: int, known_names: Mapping[str, Amount]) -> bool:
    """Whether the condition from `text_start` on holds; `and` binds tighter than `or`; both
    short-circuit.

    Raises TextError with the characters at fault.
    """
    return any(
        all(
            _is_comparison_true(written_text, part_start, part_end, known_names)
            for part_start, part_end in _parts(written_text, clause_start, clause_end, _AND)
        )
        for clause_start, clause_end in _parts(written_text, text_start, len(written_text), _OR)
    )


def _parts(
    text: str, text_start: int, text_end: int, separator: re.Pattern[str]
) -> Iterator[tuple[int, int]]:
    """Where the parts of a text begin and end."""
    for match in separator.finditer(text, text_start, text_end):
        yield text_start, match.start()
        text_start = match.end()
    yield text_start, text_end


def _is_comparison_true(
    written_text: str, text_start: int, text_end: int, known_names: Mapping[str, Amount]
) -> bool:
    """Whether comparisons of neighbours hold, `1 < i <= 5`, or do not after `not`."""
    is_expected = True
    while (match := _NOT.match(written_text, text_start, text_end)) is not None:
        text_start, is_expected = match.end(), not is_expected
    signs = list(_SIGN.finditer(written_text, text_start, text_end))
    if not signs:
        amount_text = written_text[text_start:text_end].strip()
        message = f"{quote(amount_text)} compares nothing; write i < 12, i == 3 or i mod 2 == 0"
        length = max(1, text_end - text_start)
        raise TextError(
            message, offset=min(text_start, len(written_text) - 1), length=length, code="E113"
        )
    starts = [text_start, *(sign.end() for sign in signs)]
    ends = [*(sign.start() for sign in signs), text_end]
    amounts = [_amount(written_text, *span, known_names) for span in zip(starts, ends, strict=True)]
    results = [_compare(sign, *pair) for sign, pair in zip(signs, pairwise(amounts), strict=True)]
    return all(results) == is_expected


def _amount(text: str, text_start: int, end: int, names: Mapping[str, Amount]) -> Amount:
    try:
        return evaluate(text[text_start:end], names)
    except TextError as error:
        error.offset += text_start
        raise


def _compare(sign_match: re.Match[str], first_amount: Amount, second_amount: Amount) -> bool:
    message, suggestion = "", None
    if sign_match[0] == "=":
        message, suggestion = "two values are compared by ==", "=="
    elif first_amount.unit != second_amount.unit:
        message = f"cannot compare {unit_in_words(first_amount)} and {unit_in_words(second_amount)}"
    if message:
        length = len(sign_match[0])
        raise TextError(
            message, offset=sign_match.start(), length=length, suggestion=suggestion, code="E113"
        )
    return _COMPARISONS[sign_match[0]](first_amount.number, second_amount.number)
