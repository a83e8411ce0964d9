"""The stiffness that a key meets, and the share of the piece's force that its hand may get.

It is decided here, before a piece takes over; `core-rs/live/src/perform/scale.rs` applies it
tick by tick.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from typing import TYPE_CHECKING

from ergon import _core
from ergon.live.automated import (
    CHECK_RATIO,
    MAX_SETS,
    SHORT_CHANGE,
    AutomatedValues,
    tangible_paths,
    value_sets,
)
from ergon.scores.staging.built_network import COUPLING_ENDED_SECONDS, coupling_spans
from ergon.scores.staging.version_glides import Glide

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.scores.staging.live import LiveHand
    from ergon.scores.staging.stage import Stage

# Least and greatest length of a response [ticks]. Ringing beyond the greatest length can make the
# oscillation of a key grow by half within some seconds, but no faster.
_RESPONSE_TICKS = (400, 4096)
_DIVERGED_STIFFNESS = 1e12  # [N/m]
_GLIDE_FRAMES_MAX = 20  # frames within a glide that are checked, at most
_CACHE_MAX = 256  # answers

# The force limit of a hand for a response of the piece; None: the hand has no key.
HandLimitFinder = Callable[[int, "NDArray[np.float64]"], "_core.HandLimit | None"]


@dataclass(frozen=True, slots=True)
class ForceScale:
    """The share of a piece's force that a hand may get (0 to 1), the stiffness that the key meets,
    and the greatest that its device bears [N/m].
    """

    scale: float
    stiffness_met: float
    stiffness_limit: float

    @property
    def is_enough(self) -> bool:
        """Whether the remaining force is enough to play with."""
        return self.scale >= _core.FORCE_SCALE_MIN


@dataclass(frozen=True, slots=True)
class HandForceBounds:
    """The share of force that a hand may get from a piece that takes over, tick by tick.

    `bounds`: (ticks after the takeover, greatest share from then on); `least_scale` and
    `last_scale` are the smallest and the last of them.
    """

    player: str
    bounds: tuple[tuple[int, float], ...]
    least_scale: ForceScale
    last_scale: ForceScale


@dataclass(frozen=True, slots=True)
class _MomentValues:
    """Values at one moment: (MAT, K, Z, M), (LIA, factor of its force), and LIAs that have
    ended.
    """

    cel_values: tuple[tuple[int, float, float, float], ...] = ()
    link_factors: tuple[tuple[int, float], ...] = ()
    absent_links: tuple[int, ...] = ()


def force_response(
    network: _core.Network,
    hand: LiveHand,
    rate: float,
    lever_ratio: float,
    moving_hands: Sequence[LiveHand],
) -> NDArray[np.float64]:
    """The force response against a key [N/m], (n_ticks,): in each tick after it was 1 m away for
    one tick.

    All contacts are closed; the other hands hold still.
    """
    held_mats = [other_hand.mat for other_hand in moving_hands]
    return _response_of(
        network.reachable_network(hand.mat, rate, held=held_mats), hand.tick_frames, lever_ratio
    )


def _response_of(
    reachable_network: _core.ReachableNetwork, tick_frames: int, lever_ratio: float
) -> NDArray[np.float64]:
    import numpy as np

    response = reachable_network.response(tick_frames, _RESPONSE_TICKS)
    if response is None:
        # The piece diverges by itself when its contacts are closed: no device bears that.
        return np.full(_RESPONSE_TICKS[0], _DIVERGED_STIFFNESS)
    # Hands that feel each other may move in opposite directions: a spring between two hands then
    # counts twice.
    return response * (lever_ratio * lever_ratio * (1 + reachable_network.others))


class ForceBoundsFinder:
    """Finds the force that real hands may get from a piece before it takes over.

    The answer for each distinct network that a key reaches is computed once and kept.
    `lever_ratios` has the factor between key and scene for each hand of the engine; `real_hands`
    are the numbers of hands that have a real key.
    """

    def __init__(
        self,
        hand_limit_of: HandLimitFinder,
        lever_ratios: Sequence[float],
        real_hands: Sequence[int],
    ) -> None:
        """Use `hand_limit_of`, which gives the force limit of a hand for a response."""
        self._hand_limit = hand_limit_of
        self._lever_ratios = lever_ratios
        self._real_hands = real_hands
        self._cache: dict[tuple[int, int, bytes], ForceScale] = {}
        self.n_responses = 0  # number of responses that were computed
        self._last_query: tuple[object, ...] = ()
        self._last_bounds: tuple[HandForceBounds, ...] = ()

    def force_bounds(
        self,
        stage: Stage,
        start_frame: int,
        glides: Sequence[Glide] = (),
        bounds_before: Sequence[HandForceBounds] = (),
    ) -> tuple[HandForceBounds, ...]:
        """The force that each real hand may get from a stage from frame `start_frame` on.

        `bounds_before` is the same for the stage that it takes over from. Raises EngineError.
        """
        if not self._real_hands:
            return ()
        stretches = _stretches(stage, start_frame, glides)
        glided_bounds = tuple(bounds_before) if len(stretches) > 1 else ()
        hands = [hand for hand in stage.live_hands if hand.index in self._real_hands]
        automation_values = [_value_combinations(stage, hand, hands, start_frame) for hand in hands]
        query = stretches, glided_bounds, automation_values
        if (
            self._last_query
            and self._last_query[0] is stage.network
            and self._last_query[1:] == query
        ):
            return self._last_bounds
        least_before = {
            hand_bounds.player: hand_bounds.least_scale for hand_bounds in bounds_before
        }
        bounds = []
        for hand, automated_values in zip(hands, automation_values, strict=True):
            hand_stretches = tuple(
                (frame, *_with_automation(automated_values, first_values, last_values))
                for frame, first_values, last_values in stretches
            )
            bounds.append(
                self._bounds_of(stage, hand, hands, hand_stretches, least_before.get(hand.player))
            )
        self._last_query, self._last_bounds = (stage.network, *query), tuple(bounds)
        return self._last_bounds

    def _bounds_of(
        self,
        stage: Stage,
        hand: LiveHand,
        hands: Sequence[LiveHand],
        stretches: Sequence[tuple[int, Sequence[_MomentValues], Sequence[_MomentValues]]],
        scale_before: ForceScale | None,
    ) -> HandForceBounds:
        start_frame = stretches[0][0]
        bounds: list[tuple[int, float]] = []
        scales: list[ForceScale] = []
        for stretch_index, (begin_frame, first_values, last_values) in enumerate(stretches):
            is_short = (
                len(stretches) == 2 and stretches[1][0] - start_frame <= SHORT_CHANGE * stage.rate
            )
            end_scale = self._least_scale(stage, hand, hands, last_values)
            # During a short glide, the limit of the stage before still counts at the beginning.
            old_scale = scale_before if stretch_index == 0 and is_short else None
            begin_scale = old_scale or self._least_scale(stage, hand, hands, first_values)
            lower_scale = min(begin_scale, end_scale, key=lambda force_scale: force_scale.scale)
            scales.append(lower_scale)
            is_rise = bool(bounds) and lower_scale.scale > bounds[-1][1]
            ticks = (begin_frame - start_frame) / hand.tick_frames
            bounds.append((math.ceil(ticks) if is_rise else math.floor(ticks), lower_scale.scale))
        least_scale = min(scales, key=lambda force_scale: force_scale.scale)
        return HandForceBounds(hand.player, tuple(bounds), least_scale, scales[-1])

    def _least_scale(
        self,
        stage: Stage,
        hand: LiveHand,
        hands: Sequence[LiveHand],
        moments: Sequence[_MomentValues],
    ) -> ForceScale:
        """The smallest share of force over all moments."""
        force_scales = [self._force_scale(stage, hand, hands, moment) for moment in moments]
        return min(force_scales, key=lambda force_scale: force_scale.scale)

    def _force_scale(
        self, stage: Stage, hand: LiveHand, hands: Sequence[LiveHand], moment: _MomentValues
    ) -> ForceScale:
        reachable_network = stage.network.reachable_network(
            hand.mat,
            stage.rate,
            held=[other_hand.mat for other_hand in hands],
            without=list(moment.absent_links),
            ties=list(moment.cel_values),
            factors=list(moment.link_factors),
        )
        cache_key = hand.index, reachable_network.others, reachable_network.key()
        force_scale = self._cache.pop(cache_key, None)
        if force_scale is None:
            self.n_responses += 1
            hand_limit = self._hand_limit(
                hand.index,
                _response_of(reachable_network, hand.tick_frames, self._lever_ratios[hand.index]),
            )
            assert hand_limit is not None  # the hand is real
            force_scale = ForceScale(hand_limit.scale, hand_limit.stiffness, hand_limit.limit)
        self._cache[cache_key] = force_scale  # the latest last
        if len(self._cache) > _CACHE_MAX:
            del self._cache[next(iter(self._cache))]
        return force_scale


def _value_combinations(
    stage: Stage, hand: LiveHand, hands: Sequence[LiveHand], start_frame: int
) -> tuple[AutomatedValues, ...]:
    """The values of automation that a hand may feel; a single empty set if it feels none."""
    paths = (
        tangible_paths(stage, hand.mat, [other_hand.mat for other_hand in hands])
        if stage.paths
        else {}
    )
    if not paths:
        return (AutomatedValues(),)
    combinations = tuple(islice(value_sets(stage, paths, start_frame / stage.rate), MAX_SETS + 1))
    if len(combinations) > MAX_SETS:
        names = ", ".join(".".join(filter(None, module_key)) for module_key in paths)
        raise _core.EngineError(
            f"the automation of {names} can change the force on the key of {hand.player}, and "
            f"takes more than {MAX_SETS} combinations of values, the most whose stability can be "
            "checked; use fewer steps or a smaller range, or play without the device"
        )
    return combinations


def _with_automation(
    automated_values: Sequence[AutomatedValues],
    first_values: _MomentValues,
    last_values: _MomentValues,
) -> tuple[list[_MomentValues], list[_MomentValues]]:
    """The moments at both ends of a stretch, one for each set of values of automation."""

    def moments_of(moment: _MomentValues) -> list[_MomentValues]:
        automated_moments = []
        for value_set in automated_values:
            mats = {mat for mat, *_ in value_set.cel_values}
            other_cel_values = (cel for cel in moment.cel_values if cel[0] not in mats)
            links = {link for link, _ in value_set.link_factors}
            other_factors = (factor for factor in moment.link_factors if factor[0] not in links)
            automated_moments.append(
                replace(
                    moment,
                    cel_values=(*other_cel_values, *value_set.cel_values),
                    link_factors=(*other_factors, *value_set.link_factors),
                )
            )
        return automated_moments

    return moments_of(first_values), moments_of(last_values)


def _stretches(
    stage: Stage, start_frame: int, glides: Sequence[Glide]
) -> tuple[tuple[int, _MomentValues, _MomentValues], ...]:
    """The stretches of a piece: (first frame, values at the beginning, values at the end)."""
    couplings = [
        (link, _coupling_end(stage, until))
        for link, (_, until) in zip(
            stage.built_network.coupling_links, coupling_spans(stage.piece), strict=True
        )
    ]
    moving_glides = [glide for glide in glides if _grid_frame(stage, glide.stop) > start_frame]
    moment_frames = {start_frame, *(_grid_frame(stage, glide.stop) for glide in moving_glides)}
    moment_frames |= {max(start_frame, _grid_frame(stage, glide.start)) for glide in moving_glides}
    moment_frames |= {int(end) for _, end in couplings if start_frame < end < math.inf}
    for glide in moving_glides:
        moment_frames |= set(_glide_frames(stage, glide, start_frame))
    sorted_frames = sorted(moment_frames)
    if sorted_frames[-1] - start_frame <= SHORT_CHANGE * stage.rate:
        sorted_frames = sorted({start_frame, sorted_frames[-1]})

    def values_at(frame: int, stretch_begin: int) -> _MomentValues:
        ended_links = tuple(link for link, end in couplings if end <= stretch_begin)
        return _MomentValues(*_glide_values(stage, moving_glides, frame), ended_links)

    stretches = [
        (begin_frame, values_at(begin_frame, begin_frame), values_at(end_frame, begin_frame))
        for begin_frame, end_frame in pairwise(sorted_frames)
    ]
    return *stretches, (
        sorted_frames[-1],
        values_at(sorted_frames[-1], sorted_frames[-1]),
        values_at(sorted_frames[-1], sorted_frames[-1]),
    )


def _coupling_end(stage: Stage, instant: float | None) -> float:
    """The frame from which a coupling no longer acts; infinite if it has no end."""
    if instant is None:
        return math.inf
    if instant == COUPLING_ENDED_SECONDS:
        return COUPLING_ENDED_SECONDS
    return _grid_frame(stage, instant) + -(-int(_core.FADE * stage.rate) // _core.GRID) * _core.GRID


def _grid_frame(stage: Stage, instant: float) -> int:
    return -(-int(instant * stage.rate + 0.5) // _core.GRID) * _core.GRID


def _glide_frames(stage: Stage, glide: Glide, start_frame: int) -> Iterator[int]:
    """Frames within a long glide, so dense that its numbers change by one ratio between two of
    them.
    """
    first_frame, last_frame = _grid_frame(stage, glide.start), _grid_frame(stage, glide.stop)
    if last_frame - max(first_frame, start_frame) <= SHORT_CHANGE * stage.rate:
        return
    number_pairs = [
        (before, after)
        for before, after in zip(glide.initial_values, glide.final_values, strict=True)
        if before > 0 and after > 0
    ]
    number_before, number_after = max(
        number_pairs, key=lambda pair: abs(math.log(pair[1] / pair[0])), default=(1.0, 1.0)
    )
    n_frames = min(
        _GLIDE_FRAMES_MAX,
        math.ceil(abs(math.log(number_after / number_before)) / math.log(CHECK_RATIO)),
    )
    for step_number in range(1, n_frames):
        glide_fraction = ((number_after / number_before) ** (step_number / n_frames) - 1.0) / (
            number_after / number_before - 1.0
        )
        frame = first_frame + round(glide_fraction * (last_frame - first_frame))
        if frame > start_frame:
            yield frame


def _glide_values(
    stage: Stage, glides: Sequence[Glide], glide_frame: int
) -> tuple[tuple[tuple[int, float, float, float], ...], tuple[tuple[int, float], ...]]:
    """Values of CELs and links at a frame of a glide, as the engine computes them."""
    cel_values, link_factors = [], []
    for glide in glides:
        first_frame, last_frame = _grid_frame(stage, glide.start), _grid_frame(stage, glide.stop)
        glide_fraction = min(
            1.0, max(0.0, (glide_frame - first_frame) / (last_frame - first_frame))
        )
        if glide_fraction == 1.0 and glide.network_value is None:
            continue
        module_key = glide.part, glide.module
        if len(glide.initial_values) == 3:
            # 1/M, K/M and Z/M glide linearly, because a frame uses K and Z per mass.
            (k, z, m), (to_k, to_z, to_m) = glide.initial_values, glide.final_values
            glide_mass = 1.0 / (1.0 / m + (1.0 / to_m - 1.0 / m) * glide_fraction)
            k, z = (
                glide_mass * (a / m + (b / to_m - a / m) * glide_fraction)
                for a, b in ((k, to_k), (z, to_z))
            )
            cel_values.append((stage.built_network.assembly.mats[module_key], k, z, glide_mass))
        elif len(glide.initial_values) == 2:
            factor_max = max(
                body_factor + (1.0 - body_factor) * glide_fraction
                for body_factor in glide.body_factors
            )
            link_factors += [
                (link, factor_max)
                for link in stage.built_network.assembly.generator_links[module_key]
            ]
        else:
            first_ratio, last_ratio = glide.factors
            factor = first_ratio + (last_ratio - first_ratio) * glide_fraction
            link_factors += [
                (link, factor) for link in stage.built_network.assembly.links[module_key]
            ]
    return tuple(cel_values), tuple(link_factors)
