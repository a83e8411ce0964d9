"""Starting a performance of a staged piece: hands, devices, bars and gain."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from ergon import _core
from ergon.rendering.job import BLOCK_FRAMES
from ergon.rendering.render import frames_of

from .boards import Board
from .force_bounds import force_response

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.exchange.frozen import VerifiedStem
    from ergon.scores.reading.playing import Key
    from ergon.scores.staging.live import LiveHand
    from ergon.scores.staging.stage import Stage

    from .pages import Pages

# A piece without hands is computed in ticks of this many frames: 1.5 ms at 44.1 kHz.
DEFAULT_TICK_FRAMES = 64
# Guidance of a hand: a spring against which the hand can hold, and a damper that lets it settle
# [N/m, N·s/m].
GUIDANCE_MAX = (120.0, 1.0)
# Natural frequency of a driven key on the spring that brings it back to its written path [Hz].
DRIFT_RETURN_HZ = 1.0
_BARS_MAX = 100_000


@dataclass(frozen=True, slots=True)
class PlaybackConfig:
    """How a piece is to be played; `gain` and `limit` are ratios."""

    audio: str = "auto"
    gain: float = 1.0
    limit: float = 1.0
    highpass: float | None = None
    reference: float | None = None
    start_frame: int = 0
    end_frame: int | None = None  # the frame of the piece at which it stops before its end
    boards: Sequence[Board] = ()
    guides: Mapping[str, float] = field(default_factory=dict)  # player → K [N/m]
    driven_players: Collection[str] = ()  # players whose real keys their parts move
    force_max: float | None = None
    frames_ahead: int | None = None
    audio_in: str = "auto"
    record_in: Path | None = None
    record: Path | None = None
    header: Mapping[str, object] = field(default_factory=dict)
    frozen_stems: Sequence[VerifiedStem] = ()
    fold: _core.Fold | None = None  # folds the mix to the channels of the output
    pages: Pages | None = None
    is_endless: bool = False
    has_loose_guides: bool = False  # every hand has a guide, which is off at first


def tick_frames(stage: Stage) -> int:
    """Frames of a tick."""
    return stage.live_hands[0].tick_frames if stage.live_hands else DEFAULT_TICK_FRAMES


def perform(
    stage: Stage, config: PlaybackConfig, progress: Callable[[int], None] = lambda _: None
) -> _core.Performance:
    """Begin to play a copy of a stage. Raises EngineError.

    `progress` is called with the number of frames computed so far before the first that is
    played.
    """
    import numpy as np

    frames_per_tick = tick_frames(stage)
    simulation = stage.simulation
    start_snapshot = simulation.snapshot()
    mixer = stage.mixer(highpass=config.highpass, reference=config.reference)
    first_frame = config.start_frame // frames_per_tick * frames_per_tick
    _warm_up(simulation, mixer, stage.n_channels, config, first_frame, progress)
    board_players = {player for board in config.boards for _, player in board.axes}
    real_hands = [hand for hand in stage.live_hands if hand.player in board_players]
    hands = [
        _core.LiveHand(
            hand.standin_path,
            hand.reach,
            _guidance_spring(config, hand.player, stage.piece.keys[hand.key]),
            force_response(stage.network, hand, stage.rate, hand.reach, real_hands)
            if hand in real_hands
            else np.zeros(0),
            stage.piece.keys[hand.key].measured_constants,
            _written_forces(stage, config, hand, frames_per_tick),
        )
        for hand in stage.live_hands
    ]
    boards = _live_boards(stage, config)
    record_target = _record_target(stage, config)
    fades_from = None
    if stage.fade_start is not None and not config.is_endless and config.end_frame is None:
        fades_from = max(0, stage.fade_start - first_frame)
    try:
        window = config.pages and config.pages.make_window(stage, simulation)
        performance = _core.Performance(
            simulation,
            mixer,
            tick_frames=frames_per_tick,
            audio=config.audio,
            gain=config.gain,
            limit=config.limit,
            n_frames=None if config.is_endless else config.end_frame or stage.n_frames,
            fades_from=fades_from,
            hands=hands,
            boards=boards,
            bars=bar_frames(stage, 0, stage.n_frames),
            ahead=config.frames_ahead,
            record=record_target,
            frozen=[
                _core.FrozenStem(stem.path, stem.offset, stem.n_frames, stem.taps)
                for stem in config.frozen_stems
            ],
            fold=config.fold,
            seen=window is not None,
            audio_in=config.audio_in,
            record_in=config.record_in,
        )
        if config.pages and window:
            config.pages.server.show(window, performance)
        return performance
    finally:
        simulation.restore(start_snapshot)


def _live_boards(stage: Stage, config: PlaybackConfig) -> list[_core.LiveBoard]:
    """The boards with the hands that their axes lead."""
    hand_numbers = {hand.player: hand.index for hand in stage.live_hands}
    return [
        _core.LiveBoard(
            board.url,
            [(axis, hand_numbers[player]) for axis, player in board.axes],
            config.force_max,
            [axis.for_core(number) for number, axis in board.calibrations.items()],
        )
        for board in config.boards
    ]


def _record_target(stage: Stage, config: PlaybackConfig) -> _core.RecordTarget | None:
    """The take into which the hands are recorded; None if they are not."""
    if config.record is None:
        return None
    axes = [(hand.player, hand.key) for hand in stage.live_hands]
    header_json = json.dumps({**config.header, "sent": "wire"}, ensure_ascii=False)
    return _core.RecordTarget(config.record, axes, header_json)


def bar_frames(stage: Stage, start_frame: int, stop_frame: int) -> list[int]:
    """Frames from `start_frame` to before `stop_frame` at which a bar begins."""
    tempo_map = stage.piece.tempo_map
    first_bar, _ = tempo_map.bars.bar_beat(max(0.0, tempo_map.beats(start_frame / stage.rate)))
    bar_starts: list[int] = []
    for bar in range(first_bar, first_bar + _BARS_MAX):
        bar_frame = int(tempo_map.seconds(tempo_map.bars.start(bar)) * stage.rate + 0.5)
        if bar_frame >= stop_frame:
            break
        if bar_frame >= start_frame:
            bar_starts.append(bar_frame)
    return bar_starts


def _written_forces(
    stage: Stage, config: PlaybackConfig, hand: LiveHand, frames_per_tick: int
) -> NDArray[np.float64]:
    """The forces of the part on a real key that it drives; in a session they come section by
    section.
    """
    import numpy as np

    if hand.player not in config.driven_players or config.has_loose_guides:
        return np.zeros(0)
    from ergon.scores.staging.driving import written_forces

    piece = stage.piece
    return written_forces(piece, piece.players[hand.player], frames_per_tick, hand.standin_path)


def _guidance_spring(
    config: PlaybackConfig, player: str, guided_key: Key
) -> _core.GuidanceSpring | None:
    if player in config.driven_players:
        from ergon.scores.staging.driving import moving_mass

        # Critically damped: it brings back what drifts, and a hand wins against it.
        mass, angular_frequency = moving_mass(guided_key), 2.0 * math.pi * DRIFT_RETURN_HZ
        return _core.GuidanceSpring(
            mass * angular_frequency * angular_frequency,
            2.0 * mass * angular_frequency,
            config.has_loose_guides,
        )
    if config.has_loose_guides:
        return _core.GuidanceSpring(*GUIDANCE_MAX, True)
    stiffness = config.guides.get(player)
    return None if stiffness is None else _core.GuidanceSpring(stiffness, GUIDANCE_MAX[1], False)


def _warm_up(
    simulation: _core.Simulation,
    mixer: _core.Mixer,
    n_channels: int,
    config: PlaybackConfig,
    n_frames: int,
    progress: Callable[[int], None],
) -> None:
    """Compute and mix `n_frames` unheard, so that the filters of the mixer reach their state."""
    import numpy as np

    frame_count = 0
    for computed_frames in frames_of(simulation, n_frames, BLOCK_FRAMES):
        for stem in config.frozen_stems:
            stem.copy_into(computed_frames, frame_count)
        mixer.process(computed_frames, np.zeros((len(computed_frames), n_channels)))
        frame_count += len(computed_frames)
        progress(frame_count)
