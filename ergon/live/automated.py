"""Automation that a hand may feel: the values at which the stability of its key is checked."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ergon.scores.staging.automating import numbers_at

if TYPE_CHECKING:
    from ergon.scores.staging.parameter_values import ModuleKey, Points
    from ergon.scores.staging.stage import Stage


@dataclass(frozen=True, slots=True)
class AutomatedValues:
    """(MAT, K [N/m], Z [N·s/m], M [kg]) of CELs, and (LIA, factor of its force) of links."""

    cel_values: tuple[tuple[int, float, float, float], ...] = ()
    link_factors: tuple[tuple[int, float], ...] = ()


MAX_SETS = 64  # combinations of values that are checked against each key, at most
# A change shorter than this [s] is too short for an oscillation to grow that is stable at both
# ends.
SHORT_CHANGE = 0.05
# A longer change is also checked on its way, at each change of a value by this ratio.
CHECK_RATIO = 1.2
_PROBE_FACTOR = 3.0  # a factor of stiffness and mass that shows whether a hand feels a CEL


def tangible_paths(stage: Stage, mat: int, held_mats: Sequence[int]) -> dict[ModuleKey, Points]:
    """The automation of modules that a hand on the MAT `mat` can feel, as points in time.

    `held_mats` are the MATs of all hands.
    """

    def network_key(module_key: ModuleKey, numbers: Sequence[float]) -> bytes:
        engine_values = _engine_values(stage, [module_key], [numbers])
        reachable_network = stage.network.reachable_network(
            mat,
            stage.rate,
            held=list(held_mats),
            ties=list(engine_values.cel_values),
            factors=list(engine_values.link_factors),
        )
        return reachable_network.key()

    paths_by_module = {}
    for module_key, path_points in stage.paths.items():
        first_numbers = path_points[0][1:]
        if network_key(module_key, first_numbers) != network_key(
            module_key, [_PROBE_FACTOR * x + 1.0 for x in first_numbers]
        ):
            paths_by_module[module_key] = path_points
    return paths_by_module


def _engine_values(
    stage: Stage, module_keys: Sequence[ModuleKey], number_rows: Sequence[Sequence[float]]
) -> AutomatedValues:
    """Values of modules as the engine takes them. No hand feels the automation of a BANK."""
    assembly = stage.built_network.assembly
    cel_values, link_factors = [], []
    for module_key, module_numbers in zip(module_keys, number_rows, strict=True):
        if len(module_numbers) == 3:
            stiffness, damping, mass = module_numbers
            cel_values.append((assembly.mats[module_key], stiffness, damping, mass))
        else:
            link_factors += [(link, max(module_numbers)) for link in assembly.links_of(module_key)]
    return AutomatedValues(tuple(cel_values), tuple(link_factors))


def tangible_modules(stage: Stage, players: Collection[str]) -> dict[str, list[str]]:
    """The modules with automation that real hands can feel, by player; players that feel none are
    left out."""
    hands = [hand for hand in stage.live_hands if hand.player in players]
    mats = [hand.mat for hand in hands]
    modules_by_player = {
        hand.player: [
            ".".join(filter(None, module_key))
            for module_key in tangible_paths(stage, hand.mat, mats)
        ]
        for hand in hands
        if stage.paths
    }
    return {player: names for player, names in modules_by_player.items() if names}


def value_sets(
    stage: Stage, paths: Mapping[ModuleKey, Points], begin_instant: float
) -> Iterator[AutomatedValues]:
    """The combinations of values that modules take from the instant `begin_instant` [s] on, each
    once.

    They include every combination that is held; along a change, enough of them that any other
    lies within a ratio of 1.2 of one of them.
    """
    module_keys = list(paths)
    module_paths = list(paths.values())
    instants = sorted(
        {
            begin_instant,
            *(point[0] for points in module_paths for point in points if point[0] > begin_instant),
        }
    )
    known_keys: set[object] = set()
    for value_set, duration in _values_along(module_paths, instants):
        value_key = (
            tuple(value_set)
            if duration
            else tuple(_ratio_step(x) for numbers in value_set for x in numbers)
        )
        if value_key not in known_keys:
            known_keys.add(value_key)
            yield _engine_values(stage, module_keys, value_set)


def _values_along(
    module_paths: Sequence[Points], path_instants: Sequence[float]
) -> Iterator[tuple[list[tuple[float, ...]], bool]]:
    """Values at each instant and on the way between two of them, and whether they are held
    there.
    """
    begin_instant, values_before = (
        path_instants[0],
        [numbers_at(points, path_instants[0]) for points in module_paths],
    )
    for end_instant in path_instants[1:]:
        values_now = [numbers_at(points, end_instant) for points in module_paths]
        yield values_before, values_now == values_before
        if end_instant - begin_instant > SHORT_CHANGE and values_now != values_before:
            n_steps = max(
                1,
                math.ceil(
                    math.log(_largest_ratio(values_before, values_now)) / math.log(CHECK_RATIO)
                ),
            )
            for step_number in range(1, n_steps):
                yield _interpolated(values_before, values_now, step_number / n_steps), False
        begin_instant, values_before = end_instant, values_now
    yield values_before, True


def _ratio_step(ratio: float) -> int | None:
    return None if ratio <= 0.0 else round(math.log(ratio) / math.log(CHECK_RATIO))


def _largest_ratio(
    first_rows: Sequence[Sequence[float]], second_rows: Sequence[Sequence[float]]
) -> float:
    number_pairs = [
        pair
        for first_row, second_row in zip(first_rows, second_rows, strict=True)
        for pair in zip(first_row, second_row, strict=True)
        if min(pair) > 0.0
    ]
    return max((max(pair) / min(pair) for pair in number_pairs), default=1.0)


def _interpolated(
    first_rows: Sequence[Sequence[float]], second_rows: Sequence[Sequence[float]], fraction: float
) -> list[tuple[float, ...]]:
    return [
        tuple(
            first_value + (second_value - first_value) * fraction
            for first_value, second_value in zip(first_row, second_row, strict=True)
        )
        for first_row, second_row in zip(first_rows, second_rows, strict=True)
    ]
