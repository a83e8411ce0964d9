"""A plan as a file: its decisions, island by island, so that a later run follows them.

{"ergon_plan": 2, "hash": …, "budget": {"method": "ca"},
 "choices": [[modules, times, steps, [[numbers of a body] …], counted_cost, contact_order] …]}

`budget` is what the plan was made for: `method`, `error` [dB], or `cents` with `upto` [Hz];
without any of these, the budget is by ear. A plan without `budget` is followed within the budget
of the score.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import NamedTuple

from ergon._core import IslandChoice
from ergon.common.errors import ErgonError
from ergon.common.regular import read_bounded
from ergon.common.structured import MalformedTextError, parse_json

from .safe import open_for_writing

PLAN_VERSION = 2  # 1: numbers of a body without its kind
_PLAN_BYTES_MAX = 50_000_000  # bytes: the numbers of ten million modes
_NUMBER_MAX = 2**32 - 1
_FOURTH_ORDER = 4

Budget = Mapping[str, str | float]
_BUDGET_KEYS = ("method", "error", "cents")  # one of these at most


class PlanFile(NamedTuple):
    """The content of a file: the decisions, and the budget they were made for, if the file says
    it.
    """

    choices: Sequence[IslandChoice]
    budget: Budget | None


class NotPlanError(ErgonError, ValueError):
    """The file is not a plan that this program can read."""


def plan_text(choices: Sequence[IslandChoice], digest: str, **further_fields: object) -> str:
    """A plan as the text of a file; `further_fields` are further fields at its beginning."""
    # One choice per line, so that two plans can be compared by eye and by diff.
    lines = ",\n  ".join(json.dumps(choice, separators=(",", ":")) for choice in choices)
    header = "".join(f', "{name}": {json.dumps(value)}' for name, value in further_fields.items())
    header_text = f'{{"ergon_plan": {PLAN_VERSION}, "hash": "{digest}"{header}, "choices": ['
    return f"{header_text}\n  {lines}\n]}}\n"


def write(
    path: str,
    choices: Sequence[IslandChoice],
    digest: str,
    budget: Budget,
    *,
    force: bool,
    inputs: Sequence[Path] = (),
) -> None:
    """Write a plan; all of it or nothing."""
    with open_for_writing(path, binary=True, force=force, inputs=inputs) as file:
        file.write(plan_text(choices, digest, budget=dict(budget)).encode())


def read(path: Path) -> PlanFile:
    """The plan in a file. Raises NotPlanError with a sentence."""
    try:
        plan_data = read_bounded(path, _PLAN_BYTES_MAX)
        if len(plan_data) > _PLAN_BYTES_MAX:
            raise NotPlanError(
                f"the file is larger than {_PLAN_BYTES_MAX // 1_000_000} MB, the maximum for a plan"
            )
        plan_content = parse_json(plan_data)
    except NotPlanError:
        raise
    except OSError as error:
        raise NotPlanError(error.strerror or "cannot be read") from None
    except MalformedTextError:
        raise NotPlanError("not a plan; `ergon plan SCORE -o FILE` writes one") from None
    return PlanFile(parse_choices(plan_content), _parse_budget(plan_content.get("budget")))


def _parse_budget(json_value: object) -> Budget | None:
    if json_value is None:
        return None
    if isinstance(json_value, dict) and all(map(_is_budget_entry, json_value, json_value.values())):
        is_one = sum(name in json_value for name in _BUDGET_KEYS) <= 1
        if is_one and ("cents" in json_value or "upto" not in json_value):
            return json_value
    raise NotPlanError('its budget is not valid; it must be one such as {"error": -60}')


def _is_budget_entry(wish_name: object, wish_value: object) -> bool:
    if wish_name == "method":
        return isinstance(wish_value, str)
    if not isinstance(wish_value, int | float) or isinstance(wish_value, bool):
        return False
    return wish_name in ("error", "cents", "upto") and isfinite(wish_value)


def parse_choices(choices_content: object) -> list[IslandChoice]:
    """The choices in the parsed JSON of a file. Raises NotPlanError."""
    if not isinstance(choices_content, dict) or choices_content.get("ergon_plan") != PLAN_VERSION:
        raise NotPlanError(f"not a plan of version {PLAN_VERSION}")
    choices = choices_content.get("choices")
    if not isinstance(choices, list):
        raise NotPlanError("the plan has no list of choices")
    return [_parse_choice(choice) for choice in choices]


def _parse_choice(choice_value: object) -> IslandChoice:
    if isinstance(choice_value, list) and len(choice_value) in (5, 6):
        module_names, step_times, contact_steps, body_methods, cost = choice_value[:5]
        # Plans that say no order were made when there was one.
        contact_order = choice_value[5] if len(choice_value) == 6 else _FOURTH_ORDER
        are_counts_valid = (
            _is_count(module_names) and _is_count(step_times) and _is_count(contact_steps)
        )
        is_cost_valid = (cost is None or _is_count(cost)) and _is_count(contact_order)
        if (
            are_counts_valid
            and is_cost_valid
            and isinstance(body_methods, list)
            and all(map(_is_counts, body_methods))
        ):
            return IslandChoice(
                module_names, step_times, contact_steps, body_methods, cost, contact_order
            )
    raise NotPlanError(
        "a choice is [modules, times, steps, [numbers of each body], counted_cost or null, "
        "contact_order], whole numbers"
    )


def _is_counts(value: object) -> bool:
    return isinstance(value, list) and all(map(_is_count, value))


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _NUMBER_MAX
