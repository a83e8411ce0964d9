"""Haptic guidance: a real hand is pulled along the path of another player's part."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ergon._core import EngineError
from ergon.live.perform import GUIDANCE_MAX
from ergon.repl.session.engine import GuidedPath
from ergon.repl.session.making_time import MakingTime
from ergon.repl.session.version import HandGuide, NotTakenError
from ergon.scores.staging.driving import delay_of
from ergon.scores.staging.live import leading_positions
from ergon.scores.staging.tick_forces import TickForces

if TYPE_CHECKING:
    from ergon.repl.language.recording import Guide
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.schedule import Schedule

# The length of a path [s]; it is replaced after half of it. Making one takes some hundredths of a
# second.
_PATH_DURATION = 6.0
# During a rest longer than _REST_MAX the hand is free; guidance begins _LEAD_IN before the next
# gesture [s].
_REST_MAX = 1.0
_LEAD_IN_DURATION = 0.2
# The time assumed for making the first path; later, that of the slowest of the last paths [s].
_FIRST_MAKING_TIME = 0.1


def guide_of(command: Guide) -> HandGuide:
    """The guide that a command asks for, as shares of the strongest guide. Raises NotTakenError."""
    assert command.by is not None
    stiffness_max, viscosity_max = GUIDANCE_MAX
    stiffness = stiffness_max if command.stiffness is None else command.stiffness
    if stiffness > stiffness_max:
        raise NotTakenError(
            f"K={stiffness:g}N/m is too stiff to guide a hand: {stiffness_max:g}N/m at most"
        )
    stiffness_ratio = stiffness / stiffness_max
    viscosity = stiffness_ratio * viscosity_max if command.viscosity is None else command.viscosity
    if viscosity > viscosity_max:
        raise NotTakenError(
            f"Z={viscosity:g}Ns/m is too viscous to guide a hand: {viscosity_max:g}Ns/m at most"
        )
    return HandGuide(command.by, stiffness_ratio, viscosity / viscosity_max)


def check_guide(command: Guide, schedule: Schedule, driven_players: Collection[str] = ()) -> None:
    """Refuse a guide unless the hand is real and its guide is a written part. Raises
    NotTakenError.
    """
    player, guiding_player = command.player, command.by
    if player in driven_players:
        raise NotTakenError(f"the written part of {player} drives this key already (--drive)")
    if player not in schedule.real_hands:
        raise NotTakenError(f"no real hand plays {player}: start ergon with --live {player}=DEVICE")
    if guiding_player is None:
        return
    if guiding_player in schedule.real_hands:
        raise NotTakenError(
            f"{guiding_player} is a real hand and cannot guide: name a player with a written part"
        )
    if player in schedule.engine.status().disconnected:
        raise NotTakenError(
            f"the device of {player}'s key is gone: type the line again when it is back"
        )


@dataclass(slots=True)
class Guidance:
    """Sends the engine the paths of guided hands, section by section, as the version plays."""

    schedule: Schedule
    driven_players: frozenset[str] = frozenset()  # players whose real keys their own parts move
    _running: RunningVersion | None = None  # the version whose paths were sent
    _remake_frame: int = 0  # the frame at which the next paths are made
    _guided_players: frozenset[str] = frozenset()
    _ticket: int | None = None
    _making_time: MakingTime = field(init=False)

    def __post_init__(self) -> None:
        """Expect the first path to take a while."""
        engine, rate = self.schedule.engine, self.schedule.rate
        self._making_time = MakingTime(engine, rate, _FIRST_MAKING_TIME)

    def due_paths(self) -> tuple[int, Mapping[str, GuidedPath]] | None:
        """The frame and the new paths by player, if they must be sent now; else None."""
        running, schedule = self.schedule.running, self.schedule
        players = running.version.piece.players
        guides = {
            player: guide
            for player, guide in running.version.guides.items()
            if player in schedule.real_hands and {player, guide.guiding_player} <= players.keys()
        }
        guides |= {
            player: HandGuide(player, 1.0, 1.0)
            for player in players
            if player in self.driven_players
        }
        is_remake_due = bool(guides) and schedule.engine.frame >= self._remake_frame
        if running is self._running and not is_remake_due:
            return None
        self._running = running
        if not guides and not self._guided_players:
            return None
        making_begin_frame = self._making_time.begin_frame()
        first_frame = schedule.moments.first_frame(self._making_time.expected_seconds)
        rate = schedule.rate
        tick_frames = schedule.engine.tick_frames
        ticks = range(
            first_frame // tick_frames,
            first_frame // tick_frames + int(_PATH_DURATION * rate) // tick_frames,
        )
        paths = dict(self._release_paths(guides))
        paths |= {
            player: _guided_path(
                running, player, guide, ticks, tick_frames, drives=player in self.driven_players
            )
            for player, guide in guides.items()
        }
        self._remake_frame = first_frame + int(_PATH_DURATION / 2 * rate)
        self._guided_players = frozenset(guides)
        self._making_time.add(making_begin_frame)
        return first_frame, paths

    def _release_paths(self, guides: Mapping[str, HandGuide]) -> Iterator[tuple[str, GuidedPath]]:
        import numpy as np

        for player in self._guided_players - guides.keys():
            yield player, GuidedPath(np.zeros(1), ((0, 0.0, 0.0),), np.zeros(1))

    def send(self, frame: int, paths: Mapping[str, GuidedPath]) -> None:
        """Send paths to the engine; where its queue is full, `due_paths` makes them again."""
        try:
            self._ticket = self.schedule.engine.guide(frame, paths)
        except EngineError:
            self._running = None

    def note_late(self, ticket: int) -> None:
        """If the paths of this ticket came too late, `due_paths` makes them again."""
        if ticket == self._ticket:
            self._running = None


def _guided_path(
    running: RunningVersion,
    player: str,
    guide: HandGuide,
    ticks: range,
    tick_frames: int,
    *,
    drives: bool,
) -> GuidedPath:
    """The path of a guided player in the next ticks, within the travel of its own key."""
    import numpy as np

    piece, tick_duration = running.version.piece, tick_frames / running.stage.rate
    path_forces = None
    if drives:
        delay = delay_of(piece.keys[piece.players[player].key])
        path_forces = TickForces(tick_duration, delay, ticks.start, np.zeros(len(ticks)))
    positions, playing_spans = leading_positions(
        piece, guide.guiding_player, running.spans, tick_frames, ticks, path_forces
    )
    travel_range = piece.keys[piece.players[player].key].travel
    if travel_range is not None:
        np.clip(positions, *travel_range, out=positions)
    first_instant = ticks.start * tick_duration
    tick_spans = [
        (
            round((start_instant - _LEAD_IN_DURATION - first_instant) / tick_duration),
            round((stop_instant - first_instant) / tick_duration),
        )
        for start_instant, stop_instant in _without_short_rests(playing_spans)
    ]
    strengths = guide.stiffness, guide.viscosity
    # If no other path comes in time, this one ends by letting the hand go.
    strength_steps = [
        (0, 0.0, 0.0),
        *_strength_steps(tick_spans, strengths),
        (len(positions), 0.0, 0.0),
    ]
    first_step = sum(step_tick <= 0 for step_tick, *_ in strength_steps) - 1
    current_step = (0, *strength_steps[first_step][1:])
    later_steps = (step for step in strength_steps[first_step + 1 :] if step[0] <= len(positions))
    return GuidedPath(
        positions, (current_step, *later_steps), () if path_forces is None else path_forces.forces
    )


def _without_short_rests(playing_spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Join spans that no long rest separates."""
    joined_spans: list[tuple[float, float]] = []
    for start_instant, stop_instant in sorted(playing_spans):
        if joined_spans and start_instant - joined_spans[-1][1] <= _REST_MAX:
            joined_spans[-1] = joined_spans[-1][0], max(stop_instant, joined_spans[-1][1])
        else:
            joined_spans.append((start_instant, stop_instant))
    return joined_spans


def _strength_steps(
    tick_spans: Sequence[tuple[int, int]], strengths: tuple[float, float]
) -> Iterator[tuple[int, float, float]]:
    for start_tick, stop_tick in tick_spans:
        yield start_tick, *strengths
        yield stop_tick, 0.0, 0.0
