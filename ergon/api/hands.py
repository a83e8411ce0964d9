"""Real hands of a performance: their devices, the trial of each motor's direction, and guides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ergon.common.report import Report

from .errors import DeviceError, OptionError

if TYPE_CHECKING:
    from ergon.live.boards import Board
    from ergon.live.calibration import AxisCalibration
    from ergon.live.pointer_address import PointerKey
    from ergon.live.pointer_hands import PointerHands
    from ergon.scores.reading.piece import Piece
    from ergon.scores.reading.playing import Key

    from .options import PerformanceOptions

_LET_GO_MESSAGE = "{}: let go of the key: a small pulse of force finds the direction of its motor"
_LET_GO_ALL_MESSAGE = (
    "{}: let go of the keys: small pulses of force find the directions of their motors"
)
_GUIDE_STIFFNESS_MAX = 1e6  # [N/m] of a key under a pointer: it yields 20 µm to the greatest force


def boards_of(piece: Piece, options: PerformanceOptions) -> list[Board]:
    """Devices of `--live` and `--drive`, each under a player's key. Raises OptionError."""
    from ergon.live.boards import BoardError, boards, device_urls, parse_live_options
    from ergon.live.pointer_address import is_pointer_driven, parse_pointer_address

    try:
        options_by_player = parse_live_options((*options.live, *options.drive))
        for name in options_by_player:
            if name not in piece.players:
                raise OptionError("live", no_player_message(piece, name))
        opened_boards = boards(options_by_player, device_urls() if options_by_player else {})
        for board in opened_boards:
            if is_pointer_driven(board.url):
                parse_pointer_address(board.url)
        return opened_boards
    except BoardError as error:
        raise OptionError("live", str(error)) from None


def driven_players(
    piece: Piece, options: PerformanceOptions, boards: Sequence[Board]
) -> frozenset[str]:
    """The players whose real keys their parts drive. Raises OptionError."""
    from ergon.live.pointer_address import is_pointer_driven

    driven_names = frozenset(text.partition("=")[0] for text in options.drive)
    players_with_part = {play.player for play in piece.parts}
    for board in boards:
        for _, player_name in board.axes:
            player = piece.players[player_name]
            if player_name not in driven_names:
                continue
            player_key = piece.keys[player.key]
            if is_pointer_driven(board.url):
                refusal_reason = (
                    f"{board.url} has no motor that could move a key; --live {player_name}=… plays "
                    "it"
                )
            elif player_key.measured_constants is None or (
                len(player_key.modules) > 1 and player_key.struck
            ):
                refusal_reason = (
                    f"the key {player.key} is not measured, so nobody knows by which force it "
                    f"moves; measure it with `ergon metrology {board.url}`, and write "
                    f"`calib: FILE` in the key"
                )
            elif player_name not in players_with_part and not player.standin:
                refusal_reason = (
                    f"{player_name} has no written part and no stand-in that could drive the key"
                )
            else:
                continue
            raise OptionError("drive", refusal_reason, value=player_name)
    return driven_names


def open_hands(piece: Piece, boards: Sequence[Board], report: Report) -> PointerHands:
    """Open the pointers of keys of a piece that have no device. Raises OptionError."""
    from ergon.live.boards import BoardError
    from ergon.live.pointer_address import is_pointer_driven
    from ergon.live.pointer_hands import PointerHands, open_pointer_hands

    if not any(is_pointer_driven(board.url) for board in boards):
        return PointerHands(boards)
    try:
        keys = {
            player: _pointer_key(piece.keys[piece.players[player].key])
            for board in boards
            for _, player in board.axes
        }
        opened_hands = open_pointer_hands(boards, keys)
    except BoardError as error:
        raise OptionError("live", str(error)) from None
    for sentence in opened_hands.sentences:
        report.say(sentence)
    return opened_hands


def _pointer_key(score_key: Key) -> PointerKey:
    """Travel, spring and rest of a key of the score, for one that is played without a device."""
    from ergon.live.pointer_address import PointerKey
    from ergon.scores.staging.version_glides import cel_constants

    travel = score_key.travel or PointerKey().travel
    (struck_cel,) = (module for module in score_key.modules if module.name == score_key.struck)
    if struck_cel.kind != "CEL":
        return PointerKey(travel)
    stiffness, _, _ = cel_constants(struck_cel.fields)
    return PointerKey(
        travel, min(stiffness, _GUIDE_STIFFNESS_MAX), float(struck_cel.fields.get("rest") or 0.0)
    )


def calibrated_boards(boards: Sequence[Board], unchecked: bool, report: Report) -> list[Board]:
    """The devices with the calibrations of their axes; motors of unknown direction are tried.

    A motor that is wired the other way round pushes a key away from where it should hold it. All
    are tried at the same time; an axis that does not move as it should is tried alone afterwards,
    for another one may have moved it.
    """
    from ergon import _core
    from ergon.live.boards import BoardError
    from ergon.live.calibration import calibrated_axes, stored_calibrations

    try:
        calibrations = [stored_calibrations(board.url) for board in boards]
        uncalibrated_axes = [
            [axis for axis in board.axes if axis[0] not in calibrated_axes(board.url)]
            if board.has_motor and not unchecked
            else []
            for board in boards
        ]
        tried_players = [player for axes in uncalibrated_axes for _, player in axes]
        if tried_players:
            request_text = _LET_GO_MESSAGE if len(tried_players) == 1 else _LET_GO_ALL_MESSAGE
            report.say(request_text.format(", ".join(tried_players)))
        tried_axes = _try_together(boards, uncalibrated_axes, calibrations)
        for board, axes, board_calibrations, new_axes in zip(
            boards, uncalibrated_axes, calibrations, tried_axes, strict=True
        ):
            for number, player in axes:
                _find_direction(
                    board, number, player, board_calibrations, new_axes.get(number), report
                )
    except BoardError as error:
        raise OptionError("live", str(error)) from None
    except _core.EngineError as error:
        raise DeviceError(str(error)) from None
    boards_and_axes = zip(boards, calibrations, strict=True)
    return [
        replace(board, calibrations=board_calibrations)
        for board, board_calibrations in boards_and_axes
    ]


def _try_together(
    boards: Sequence[Board],
    uncalibrated_axes: Sequence[Sequence[tuple[int, str]]],
    calibrations: Sequence[dict[int, AxisCalibration]],
) -> list[dict[int, AxisCalibration]]:
    """The axes of each device that move as they should when all are pushed at the same time.

    The axes of an arm move each other, so each is tried alone.
    """
    from concurrent.futures import ThreadPoolExecutor

    from ergon.live.calibration import confirm_axes

    def try_board(board_index: int) -> dict[int, AxisCalibration]:
        axis_numbers = [number for number, _ in uncalibrated_axes[board_index]]
        if not axis_numbers or boards[board_index].kind == "haply":
            return {}
        calibrations_before = calibrations[board_index]
        return confirm_axes(
            boards[board_index].url,
            {number: calibrations_before.get(number) for number in axis_numbers},
        )

    if sum(map(len, uncalibrated_axes)) < 2:
        return [{} for _ in boards]
    with ThreadPoolExecutor(len(boards)) as pool:
        return list(pool.map(try_board, range(len(boards))))


def _find_direction(
    board: Board,
    axis: int,
    player: str,
    calibrations: dict[int, AxisCalibration],
    known_axis: AxisCalibration | None,
    report: Report,
) -> None:
    """Put the direction of an axis into `calibrations`; push it a little without a `known_axis`."""
    from ergon import _core
    from ergon.live.calibration import axis_key, find_direction, store_axis

    old_calibration = calibrations.get(axis)
    motor_sign = 1 if old_calibration is None else old_calibration.sign
    try:
        known_axis = known_axis or find_direction(board.url, axis, old_calibration)
        if (
            board.is_emulated and known_axis.sign != motor_sign
        ):  # perhaps a hand moved the key with the pulse
            known_axis = find_direction(board.url, axis, old_calibration)
    except _core.UnsureError as error:
        if board.is_emulated:
            report.warn(f"{player}: {error}; the key is emulated, so it plays all the same")
            return
        raise OptionError(
            "live", f"{error} (--unchecked plays without a trial)", value=player
        ) from None
    if known_axis.sign != motor_sign and board.is_emulated:
        raise OptionError(
            "live",
            f"the motor pushes the wrong way; `ergon devices calibrate {board.url} "
            f"--axis {axis}` corrects that (--unchecked plays without a trial)",
            value=player,
        )
    if known_axis is old_calibration or board.is_emulated:
        return
    if old_calibration is not None:
        report.warn(
            f"{player}: {axis_key(board.url, axis)} moves against the direction of its "
            "calibration, so it is taken for another board, whose ends are not known"
        )
    calibrations[axis] = known_axis
    store_axis(board.url, axis, known_axis)


def guide_stiffnesses(
    piece: Piece, boards: Sequence[Board], stiffness_options: Sequence[str]
) -> dict[str, float]:
    """Stiffness of the guide [N/m] of each player in `PLAYER[=STIFFNESS]`. Raises OptionError."""
    from ergon.live.perform import GUIDANCE_MAX
    from ergon.notation.tables.quantities import STIFFNESS, quantity
    from ergon.notation.text.errors import TextError

    real_players = {player for board in boards for _, player in board.axes}
    stiffness_by_player = {}
    for stiffness_text in stiffness_options:
        player, equals_sign, stiffness_word = stiffness_text.partition("=")
        if player not in real_players:
            if player not in piece.players:
                raise OptionError("guide", no_player_message(piece, player))
            reason = f"{player} has no device; --live {player}=DEVICE gives one"
            raise OptionError("guide", reason, value=stiffness_text)
        try:
            stiffness_by_player[player] = (
                quantity(stiffness_word, STIFFNESS) if equals_sign else GUIDANCE_MAX[0]
            )
        except TextError as error:
            raise OptionError("guide", error.message, value=stiffness_text) from None
    return stiffness_by_player


def no_player_message(piece: Piece, name: str) -> str:
    """The sentence for a player whom the score does not have."""
    from ergon.notation.text.spelling import nearest

    nearest_player = nearest(name, piece.players)
    hint = f"; did you mean '{nearest_player}'?" if nearest_player else ""
    return f"the score has no player '{name}'{hint}"
