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
_NUMBER_PATTERN = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_RANGE_PATTERN = re.compile(
    rf"(?P<low>{_NUMBER_PATTERN})(?P<unit>(?:[^\d.:][^.:]*)?)\.\.(?P<high>{_NUMBER_PATTERN})(?P<unit2>(?:[^\d.:\s][^.:\s]*)?)"
    r"(?::(?P<count>\d+))?(?P<log>\s+log)?"
)
_EXAMPLE = "such as bell.m.K=1kN/m..9kN/m:32, seed=1..16 or bell.m.f=A3,C4"


@dataclass(frozen=True, slots=True)
class VariedTarget:
    """A target, named as in `set` of a session, and the texts of its values."""

    target: str
    values: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Variant:
    """The values of one variant, in the order of the targets, and the score with them set."""

    values: tuple[str, ...]
    texts: Texts
    loaded: Loaded


def parse(varied_text: str) -> VariedTarget:
    """Read `TARGET=VALUES`: a list, or a range with its number of points. Raises EditError."""
    target_path, equals_sign, values_text = varied_text.partition("=")
    target_path, values_text = target_path.strip(), values_text.strip()
    if not equals_sign or not target_path or not values_text:
        raise EditError(f"{quote(varied_text)} is not TARGET=VALUES, {_EXAMPLE}")
    if ".." in values_text:
        return VariedTarget(target_path, tuple(_values_of_range(target_path, values_text)))
    value_texts = tuple(word.strip() for word in values_text.split(","))
    if not all(value_texts):
        raise EditError(f"{quote(varied_text)} has an empty value; write {target_path}=1,2,5")
    if repeated_value := next(
        (value for value in value_texts if value_texts.count(value) > 1), None
    ):
        raise EditError(f"{quote(varied_text)} has the value {repeated_value} twice")
    return VariedTarget(target_path, value_texts)


def value_combinations(
    varied_targets: Sequence[VariedTarget], *, is_zipped: bool
) -> list[tuple[str, ...]]:
    """The values of every variant: all combinations, or (zipped) one value of each. Raises
    EditError.
    """
    targets = [varied_target.target for varied_target in varied_targets]
    if repeated_name := next((name for name in targets if targets.count(name) > 1), None):
        raise EditError(f"{repeated_name} varies twice; give all its values at once")
    value_counts = [len(varied_target.values) for varied_target in varied_targets]
    if is_zipped and len(set(value_counts)) > 1:
        counts_text = ", ".join(
            f"{varied_target.target} has {len(varied_target.values)}"
            for varied_target in varied_targets
        )
        raise EditError(f"pairs need as many values of each: {counts_text}")
    n_variants = value_counts[0] if is_zipped else math.prod(value_counts)
    if n_variants > VARIANTS_MAX:
        raise EditError(f"these are {n_variants:,} variants; a sweep has at most {VARIANTS_MAX:,}")
    columns = [varied_target.values for varied_target in varied_targets]
    return list(zip(*columns, strict=True) if is_zipped else itertools.product(*columns))


def variants(
    score_texts: Texts, targets: Sequence[str], combined_values: Sequence[tuple[str, ...]]
) -> Iterator[Variant]:
    """The score with each of the combined values set; one with mistakes has no piece.

    Raises EditError if a target cannot be set.
    """
    loaded_base = score_texts.load()
    for variant_values in combined_values:
        edited_texts, loaded = score_texts, loaded_base
        for target_path, value in zip(targets, variant_values, strict=True):
            if loaded.piece is None:
                break
            edited_texts = _with_value(edited_texts, loaded.piece, target_path, value)
            loaded = edited_texts.load()
        yield Variant(variant_values, edited_texts, loaded)


def _with_value(score_texts: Texts, piece: Piece, target_path: str, value_text: str) -> Texts:
    if target_path == SEED:
        if not re.fullmatch(r"\d+", value_text):
            raise EditError(f"seed={value_text}: a seed is a whole number")
        return names.set_seed(score_texts, int(value_text))
    if any(entry.name == target_path for entry in piece.automation):
        raise EditError(
            f"{target_path} is changed by `automation`, so a value set here would not be "
            "heard; remove the automation"
        )
    try:
        return matter.set_value(score_texts, piece, target_path, value_text)
    except TextError as error:
        raise EditError(f"{target_path}={value_text}: {error}") from None


def _values_of_range(target_path: str, range_text: str) -> Iterator[str]:
    range_match = _RANGE_PATTERN.fullmatch(range_text)
    if range_match is None:
        raise EditError(f"{quote(f'{target_path}={range_text}')} is not a range, {_EXAMPLE}")
    unit_text, second_unit = range_match["unit"].strip(), range_match["unit2"].strip()
    if unit_text != second_unit:
        raise EditError(
            f"{quote(f'{target_path}={range_text}')}: write both ends in one unit; "
            f"these are {unit_text or 'none'} and {second_unit or 'none'}"
        )
    low_end, high_end, is_log = (
        float(range_match["low"]),
        float(range_match["high"]),
        range_match["log"] is not None,
    )
    if range_match["count"] is None:
        yield from (
            f"{number}{unit_text}"
            for number in _range_steps(target_path, range_text, low_end, high_end, is_log)
        )
        return
    n_values = int(range_match["count"])
    if not 2 <= n_values <= VARIANTS_MAX:
        raise EditError(
            f"{target_path}: a range has from 2 to {VARIANTS_MAX:,} points, not {n_values}"
        )
    if low_end == high_end:
        raise EditError(
            f"{target_path}: both ends of the range are {range_match['low']}{unit_text}"
        )
    if is_log and not low_end * high_end > 0.0:
        raise EditError(f"{target_path}: a `log` range has both ends above 0, or both below")
    for value_index in range(n_values):
        fraction = value_index / (n_values - 1)
        interpolated = (
            low_end * (high_end / low_end) ** fraction
            if is_log
            else low_end + (high_end - low_end) * fraction
        )
        number = (
            (low_end, high_end)[value_index > 0]
            if value_index in (0, n_values - 1)
            else interpolated
        )
        if target_path == SEED and number != int(number):
            raise EditError(f"seed={range_text}: a seed is a whole number; write seed=1..16")
        yield f"{number:.9g}{unit_text}"


def _range_steps(
    target_path: str, range_text: str, low_end: float, high_end: float, is_log: bool
) -> range:
    if is_log or low_end != int(low_end) or high_end != int(high_end):
        raise EditError(
            f"{quote(f'{target_path}={range_text}')}: say how many points the range has, "
            f"such as {target_path}={range_text.removesuffix('log').strip()}:8"
        )
    if not low_end < high_end or high_end - low_end >= VARIANTS_MAX:
        raise EditError(
            f"{quote(f'{target_path}={range_text}')}: a range rises, by less than {VARIANTS_MAX:,}"
        )
    return range(int(low_end), int(high_end) + 1)
