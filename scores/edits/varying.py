"""Variants of a score: `bell.m.K=1kN/m..9kN/m:32`, `seed=1..16`, their products and pairs."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError, quote
from ergon.scores.edits import matter, names
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.load import Loaded
from ergon.scores.reading.piece import Piece

VARIANTS_MAX = 10_000
SEED = "seed"
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_RANGE = re.compile(
    rf"(?P<low>{_NUMBER})(?P<unit>(?:[^\d.:][^.:]*)?)\.\.(?P<high>{_NUMBER})(?P<unit2>(?:[^\d.:\s][^.:\s]*)?)"
    r"(?::(?P<count>\d+))?(?P<log>\s+log)?"
)
_EXAMPLE = "such as bell.m.K=1kN/m..9kN/m:32, seed=1..16 or bell.m.f=A3,C4"


@dataclass(frozen=True, slots=True)
class Varied:
    """A target, named as in `set` of a session, and the texts of its values."""

    target: str
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Variant:
    """The values of one variant, in the order of the targets, and the score with them set."""

    values: tuple[str, ...]
    texts: Texts
    loaded: Loaded


def parse(text: str) -> Varied:
    """Read `TARGET=VALUES`: a list, or a range with its number of points. Raises EditError."""
    target, equals, values_text = text.partition("=")
    target, values_text = target.strip(), values_text.strip()
    if not equals or not target or not values_text:
        raise EditError(f"{quote(text)} is not TARGET=VALUES, {_EXAMPLE}")
    if ".." in values_text:
        return Varied(target, tuple(_range(target, values_text)))
    values = tuple(word.strip() for word in values_text.split(","))
    if not all(values):
        raise EditError(f"{quote(text)} has an empty value; write {target}=1,2,5")
    if twice := next((value for value in values if values.count(value) > 1), None):
        raise EditError(f"{quote(text)} has the value {twice} twice")
    return Varied(target, values)


def combined(varied: Sequence[Varied], *, is_zipped: bool) -> list[tuple[str, ...]]:
    """The values of every variant: all combinations, or (zipped) one value of each. Raises
    EditError.
    """
    targets = [variation.target for variation in varied]
    if twice := next((name for name in targets if targets.count(name) > 1), None):
        raise EditError(f"{twice} varies twice; give all its values at once")
    lengths = [len(variation.values) for variation in varied]
    if is_zipped and len(set(lengths)) > 1:
        counts_text = ", ".join(
            f"{variation.target} has {len(variation.values)}" for variation in varied
        )
        raise EditError(f"pairs need as many values of each: {counts_text}")
    count = lengths[0] if is_zipped else math.prod(lengths)
    if count > VARIANTS_MAX:
        raise EditError(f"these are {count:,} variants; a sweep has at most {VARIANTS_MAX:,}")
    columns = [variation.values for variation in varied]
    return list(zip(*columns, strict=True) if is_zipped else itertools.product(*columns))


def variants(
    texts: Texts, targets: Sequence[str], values: Sequence[tuple[str, ...]]
) -> Iterator[Variant]:
    """The score with each of the combined values set; one with mistakes has no piece.

    Raises EditError if a target cannot be set.
    """
    loaded_base = texts.load()
    for variant_values in values:
        edited, loaded = texts, loaded_base
        for target, value in zip(targets, variant_values, strict=True):
            if loaded.piece is None:
                break
            edited = _with(edited, loaded.piece, target, value)
            loaded = edited.load()
        yield Variant(variant_values, edited, loaded)


def _with(texts: Texts, piece: Piece, target: str, value: str) -> Texts:
    if target == SEED:
        if not re.fullmatch(r"\d+", value):
            raise EditError(f"seed={value}: a seed is a whole number")
        return names.seed(texts, int(value))
    if any(entry.name == target for entry in piece.automation):
        raise EditError(
            f"{target} is changed by `automation`, so a value set here would not be "
            "heard; remove the automation"
        )
    try:
        return matter.set_value(texts, piece, target, value)
    except TextError as error:
        raise EditError(f"{target}={value}: {error}") from None


def _range(target: str, range_text: str) -> Iterator[str]:
    match = _RANGE.fullmatch(range_text)
    if match is None:
        raise EditError(f"{quote(f'{target}={range_text}')} is not a range, {_EXAMPLE}")
    unit, second_unit = match["unit"].strip(), match["unit2"].strip()
    if unit != second_unit:
        raise EditError(
            f"{quote(f'{target}={range_text}')}: write both ends in one unit; "
            f"these are {unit or 'none'} and {second_unit or 'none'}"
        )
    low, high, is_log = float(match["low"]), float(match["high"]), match["log"] is not None
    if match["count"] is None:
        yield from (f"{x}{unit}" for x in _steps(target, range_text, low, high, is_log))
        return
    count = int(match["count"])
    if not 2 <= count <= VARIANTS_MAX:
        raise EditError(f"{target}: a range has from 2 to {VARIANTS_MAX:,} points, not {count}")
    if low == high:
        raise EditError(f"{target}: both ends of the range are {match['low']}{unit}")
    if is_log and not low * high > 0.0:
        raise EditError(f"{target}: a `log` range has both ends above 0, or both below")
    for i in range(count):
        t = i / (count - 1)
        between = low * (high / low) ** t if is_log else low + (high - low) * t
        x = (low, high)[i > 0] if i in (0, count - 1) else between
        if target == SEED and x != int(x):
            raise EditError(f"seed={range_text}: a seed is a whole number; write seed=1..16")
        yield f"{x:.9g}{unit}"


def _steps(target: str, range_text: str, low: float, high: float, is_log: bool) -> range:
    if is_log or low != int(low) or high != int(high):
        raise EditError(
            f"{quote(f'{target}={range_text}')}: say how many points the range has, "
            f"such as {target}={range_text.removesuffix('log').strip()}:8"
        )
    if not low < high or high - low >= VARIANTS_MAX:
        raise EditError(
            f"{quote(f'{target}={range_text}')}: a range rises, by less than {VARIANTS_MAX:,}"
        )
    return range(int(low), int(high) + 1)
