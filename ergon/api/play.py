"""A score on its way to the loudspeakers: staged, with devices, gain and frozen parts."""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report
from ergon.rendering.level import HIGHPASS_HZ
from ergon.scores.reading.digest import digest_of

from . import freeze
from . import score as scores
from .errors import OptionError, not_started_error
from .fold import fold_of
from .gain import performance_gain
from .hands import (
    boards_of,
    calibrated_boards,
    driven_players,
    guide_stiffnesses,
    no_player_message,
    open_hands,
)
from .options import PlayOptions
from .osc import osc_of
from .pages import pages_of, sees_all

if TYPE_CHECKING:
    from ergon import _core
    from ergon.exchange.frozen import VerifiedStem
    from ergon.live.boards import Board
    from ergon.live.osc import OscServer
    from ergon.live.perform import PlaybackConfig
    from ergon.live.pointer_hands import PointerHands
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage

_ABSENT_HAND_NOTES = ("N401",)  # a note that a live hand is absent: `play` shows that itself


@dataclass(frozen=True, slots=True)
class PreparedPlay:
    """A score ready to be played."""

    stage: Stage
    hands: PointerHands
    config: PlaybackConfig
    osc: OscServer | None

    def close(self) -> None:
        """End the server of pages, and close the sources that hands follow."""
        if self.config.pages is not None:
            self.config.pages.close()
        self.hands.close()


def prepare(path: str | Path, options: PlayOptions, report: Report) -> PreparedPlay:
    """Stage a score, open its devices and find its gain.

    Raises ScoreError, OptionError and DeviceError.
    """
    is_seen = sees_all(options)
    loaded = scores.read(path, options, report, leave_out=_ABSENT_HAND_NOTES)
    score_piece = scores.piece_of(loaded)
    piece = _with_stand_ins(score_piece, options.standin)
    loaded = replace(loaded, piece=piece)
    boards = boards_of(piece, options)
    driven_names = driven_players(piece, options, boards)
    real_players = {player: None for board in boards for _, player in board.axes}
    osc = osc_of(options.osc, options.osc_to, report)
    frozen = None
    if options.frozen is not None:
        frozen = freeze.read(score_piece, Path(options.frozen), options.seed, report)
        freeze.check_freezable(piece, frozen, real_players)
    boards = calibrated_boards(boards, options.unchecked, report)
    stage = scores.stage_piece(
        loaded,
        options,
        report,
        real_hands=real_players,
        silent=() if frozen is None else frozen.parts,
        on_fault="mute",
        is_seen=is_seen,
    ).stage
    _refuse_tangible_automation(stage, real_players)
    stems: Sequence[VerifiedStem] = ()
    if frozen is not None and options.frozen is not None:
        stems = freeze.verify_stems(stage, frozen, Path(options.frozen))
        report.say(f"from {options.frozen}: {', '.join(frozen.parts)}")
    config = replace(
        _performance_config(piece, stage, boards, options, stems, report),
        driven_players=driven_names,
    )
    hands = open_hands(piece, boards, report)
    try:
        pages = pages_of(options, report, hands.page_pointers)
    except OptionError:
        hands.close()
        raise
    return PreparedPlay(stage, hands, replace(config, boards=hands.boards, pages=pages), osc)


def _refuse_tangible_automation(stage: Stage, real_players: Collection[str]) -> None:
    """Raise OptionError if automation changes what a hand feels, whose stability is not checked."""
    from ergon.live.automated import tangible_modules

    for player, module_names in tangible_modules(stage, real_players).items():
        raise OptionError(
            "live",
            f"the automation of {', '.join(module_names)} can change the force on the key of "
            f"{player}, "
            "and this command checks the stability of the device for the values at the beginning "
            "only; use `ergon repl`, which checks all values, or play without this device",
        )


def begin(stage: Stage, config: PlaybackConfig, report: Report) -> _core.Performance:
    """Begin the performance that `config` describes. Raises DeviceError, FileRefusedError."""
    from ergon import _core
    from ergon.live.perform import perform

    try:
        with report.progress("going there", config.start_frame, stage.rate) as progress:
            return perform(stage, config, progress.update)
    except _core.EngineError as error:
        raise not_started_error(error, _fault_sentence(error, stage)) from None


def warn_of_scaled_forces(performance: _core.Performance, stage: Stage, report: Report) -> None:
    """Warn of each hand whose forces are scaled because its device cannot bear the piece."""
    for hand_limit in performance.hand_limits():
        if hand_limit.scale < 1.0:
            live_hand = stage.live_hands[hand_limit.hand]
            report.warn(
                f"{live_hand.player} on {live_hand.key}: the piece is "
                f"{hand_limit.stiffness:,.0f} N/m stiff "
                f"at this key, and the device is stable up to {hand_limit.limit:,.0f} N/m at "
                f"{stage.rate / live_hand.tick_frames:.0f} Hz; forces on {live_hand.player} "
                "are scaled to "
                f"{hand_limit.scale:.0%}"
            )


def _fault_sentence(error: _core.EngineError, stage: Stage) -> str:
    """The sentence of an error of the core, with the player whose hand is at fault."""
    if error.index is None:
        return str(error)
    faulty_hand = stage.live_hands[error.index]
    return f"{faulty_hand.player} on {faulty_hand.key}: {error.sentence}"


def _with_stand_ins(piece: Piece, standin_pairs: Sequence[str]) -> Piece:
    """The piece with the takes or gestures that stand in for absent hands."""
    players = dict(piece.players)
    for standin_pair in standin_pairs:
        player_name, _, standin_name = standin_pair.partition("=")
        if player_name not in players:
            raise OptionError("standin", no_player_message(piece, player_name))
        if standin_name not in piece.takes and standin_name not in piece.gestures:
            raise OptionError(
                "standin", f"no take or gesture is called '{standin_name}'", value=standin_pair
            )
        if any(part_play.player == player_name for part_play in piece.parts):
            raise OptionError(
                "standin",
                f"{player_name} has a written part, which is the stand-in",
                value=standin_pair,
            )
        players[player_name] = replace(players[player_name], standin=standin_name)
    return replace(piece, players=players)


def _performance_config(
    piece: Piece,
    stage: Stage,
    boards: Sequence[Board],
    play_options: PlayOptions,
    stems: Sequence[VerifiedStem],
    report: Report,
) -> PlaybackConfig:
    from ergon.live.perform import PlaybackConfig, tick_frames

    start_frame = 0
    if play_options.from_ is not None:
        start_frame = int(scores.instant(piece, play_options.from_, "from_") * stage.rate + 0.5)
        if start_frame >= stage.n_frames:
            position_text = scores.where(piece, stage.n_frames / stage.rate)
            raise OptionError(
                "from_", f"the piece ends at {position_text}", value=play_options.from_
            )
    end_frame: int | None = None
    if play_options.until is not None:
        end_frame = int(scores.instant(piece, play_options.until, "until") * stage.rate + 0.5)
        if end_frame <= start_frame:
            position_text = scores.where(piece, start_frame / stage.rate)
            message = f"it begins at {position_text}; stop later than that"
            raise OptionError("until", message, value=play_options.until)
        end_frame = min(end_frame, stage.n_frames)
    master = piece.mix.master
    limit = master.limit if master is not None and master.limit is not None else 1.0
    recording_path = play_options.record or play_options.record_input
    if play_options.loop and (recording_path or play_options.audio.startswith("file:")):
        raise OptionError("loop", "excludes --record, --record-input and file:, written once")
    scores.integer_rate(stage.rate)
    new_recording_path = (
        None if play_options.record is None else _new_recording_path(play_options.record, stage)
    )
    config = PlaybackConfig(
        audio=play_options.card,
        gain=performance_gain(piece, lambda: stage, play_options.gain, report, stems),
        limit=limit,
        highpass=HIGHPASS_HZ,
        reference=piece.mix.reference(),
        start_frame=start_frame // tick_frames(stage) * tick_frames(stage),
        end_frame=end_frame,
        boards=boards,
        guides=guide_stiffnesses(piece, boards, play_options.guide),
        force_max=play_options.force_max,
        frames_ahead=play_options.ahead,
        audio_in=play_options.audio_in,
        record_in=_input_file(play_options, piece),
        record=new_recording_path,
        frozen_stems=stems,
        fold=fold_of(piece, play_options, report),
    )
    if new_recording_path is None:
        return config
    return replace(config, header=_recording_description(piece, stage, config, play_options))


def _recording_description(
    piece: Piece, stage: Stage, config: PlaybackConfig, play_options: PlayOptions
) -> dict[str, object]:
    """The description at the beginning of a recording."""
    from ergon import _core
    from ergon.live.calibration import axis_header
    from ergon.live.recorded import level_header

    devices = {
        player: axis_header(board, number)
        for board in config.boards
        for number, player in board.axes
    }
    return {
        "made": f"by ergon {_core.__version__}",
        "day": time.strftime("%Y-%m-%d %H:%M:%S"),
        "score": {"sha256": digest_of(piece), "title": piece.title},
        "seed": piece.seed if play_options.seed is None else play_options.seed,
        "plan": stage.plan.hash if stage.plan else "",
        "level": level_header(config),
        "axes": [devices.get(hand.player, {"device": None}) for hand in stage.live_hands],
    }


def _input_file(play_options: PlayOptions, piece: Piece) -> Path | None:
    """The new file that records inputs from the beginning of the piece. Raises OptionError."""
    if play_options.record_input is None:
        return None
    if not any(take.card_channel for take in piece.takes.values()):
        raise OptionError(
            "record_input", "this score has no inputs to record; leave this option out"
        )
    if play_options.from_ is not None:
        raise OptionError(
            "record_input", "; a recording of inputs begins with the piece", excludes="from_"
        )
    if Path(play_options.record_input).suffix.lower() != ".wav":
        raise OptionError(
            "record_input", "the file must end in .wav", value=play_options.record_input
        )
    if Path(play_options.record_input).exists():
        message = f"{play_options.record_input} exists, and a recording overwrites no file"
        raise OptionError("record_input", message)
    return Path(play_options.record_input)


def _new_recording_path(path: str, stage: Stage) -> Path:
    if not stage.live_hands:
        raise OptionError("record", "this score has no live hands to record; leave this option out")
    record_path = Path(path)
    if record_path.exists():
        raise OptionError("record", f"{path} exists, and a recording overwrites no file")
    return record_path
