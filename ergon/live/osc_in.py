"""OSC requests to a performance: one function for each address."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Protocol

from ergon import _core
from ergon.common.errors import ErgonError
from ergon.notation.tables.quantities import LOUDEST_DB

if TYPE_CHECKING:
    from ergon.instruments.model import Module
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage

    Handler = Callable[[Sequence[object]], None]
    # Executes a line of the prompt; raises OscRequestError if it is refused.
    Command = Callable[[str], None]


class HandlerTable(Protocol):
    """Address → handler of its arguments."""

    def get(self, address: str, /) -> Handler | None:
        """The handler of an address; None if the address is unknown."""


SILENT_DB = -144.0
_COMMAND_LENGTH_MAX = 1000  # characters: a line that somebody types is shorter


class OscRequestError(ErgonError):
    """An OSC request that is refused; the message goes back to the sender."""


def is_harmless(address: str) -> bool:
    """Whether a request cannot raise a force: it silences, stops or sets a level."""
    return address in ("/ergon/panic", "/ergon/stop") or address.endswith("/gain")


def refuse_command(_line: str) -> None:
    """Refuse a command, for a performance without a prompt. Raises OscRequestError."""
    raise OscRequestError("commands need a session: ergon repl takes them, ergon play does not")


def request_handlers(
    performance: _core.Performance,
    stage: Stage,
    gain: float,
    stop_playing: Callable[[], None],
    input_handler: Callable[[str], Handler],
    run_command: Command = refuse_command,
) -> dict[str, Handler]:
    """Address → handler of its arguments. `gain` is the ratio of 0 dB; `input_handler`
    gives the handler of an input by its name.
    """
    part_names = stage.listening.parts()
    groups_by_name = {name: group for group, name in enumerate(part_names)}

    def gain_setter(names: Iterable[str]) -> Callable[[float], None]:
        group_indices = [groups_by_name[name] for name in names]
        return lambda ratio: _check_accepted(
            [performance.part_gain(group, ratio) for group in group_indices]
        )

    instruments_by_player = exclusive_instruments(stage.piece, part_names)
    input_names = (name for name, take in stage.piece.takes.items() if take.is_from_osc)
    return {
        "/ergon/cmd": text_handler(run_command),
        "/ergon/panic": button_handler(performance.panic),
        "/ergon/release": button_handler(performance.release),
        "/ergon/stop": button_handler(stop_playing),
        "/ergon/gain": gain_handler(
            lambda ratio: _check_accepted([performance.gain(gain * ratio)])
        ),
        **{
            f"/ergon/instrument/{name}/gain": gain_handler(gain_setter([name]))
            for name in part_names
        },
        **{
            f"/ergon/player/{player}/gain": gain_handler(gain_setter(instrument_names))
            if instrument_names
            else _shared_key_handler(player)
            for player, instrument_names in instruments_by_player.items()
        },
        **{f"/ergon/input/{name}": input_handler(name) for name in input_names},
    }


def exclusive_instruments(piece: Piece, part_names: Sequence[str]) -> dict[str, list[str]]:
    """Player → those instruments of `part_names` that links connect with the player's key and no
    other.
    """
    instruments_by_key = {key: _reachable_instruments(piece, key) for key in piece.keys}
    parts_by_player = {}
    for player in piece.players.values():
        reached_by_others = set().union(
            *(names for key, names in instruments_by_key.items() if key != player.key)
        )
        parts_by_player[player.name] = [
            part
            for part in part_names
            if part in instruments_by_key[player.key] - reached_by_others
        ]
    return parts_by_player


def _reachable_instruments(piece: Piece, key_name: str) -> set[str]:
    """Instruments that links connect with a key, without passing through another key."""
    neighbours: dict[str, set[str]] = {}
    for joined_parts in _joined_parts(piece):
        for joined_part in joined_parts:
            neighbours.setdefault(joined_part, set()).update(joined_parts)
    instruments: set[str] = set()
    parts_to_visit = [key_name]
    while parts_to_visit:
        for part in neighbours.get(parts_to_visit.pop(), set()) - instruments - piece.keys.keys():
            instruments.add(part)
            parts_to_visit.append(part)
    return instruments


def _joined_parts(piece: Piece) -> Iterator[set[str]]:
    """For each link, the parts that it joins: those of its two ends, and the one in which it is
    written.
    """
    parts_with_modules: list[tuple[str, Sequence[Module]]] = [
        *((name, key.modules) for name, key in piece.keys.items()),
        *((name, instrument.modules) for name, instrument in piece.instruments.items()),
    ]
    for part_name, modules in parts_with_modules:
        for module in modules:
            if module.ends:
                yield {part_name, *(end.part for end in module.ends)}


def _check_accepted(acceptances: Sequence[bool]) -> None:
    if not all(acceptances):
        raise OscRequestError("too many requests at once; this one was dropped")


# --- arguments ------------------------------------------------------------------------------------


def button_handler(action: Callable[[], object]) -> Handler:
    """Handle a button, which sends no argument, or 1 when it is pressed and 0 when it is
    released.
    """

    def handle(arguments: Sequence[object]) -> None:
        if not arguments or arguments[0] not in (0, False):
            action()

    return handle


def gain_handler(action: Callable[[float], object]) -> Handler:
    """Handle a level in dB: pass its ratio to `action`."""
    return level_handler(lambda level: action(_core.decibels(level) if level > SILENT_DB else 0.0))


def level_handler(action: Callable[[float], object]) -> Handler:
    """Handle a level in dB: pass it to `action`."""

    def handle(arguments: Sequence[object]) -> None:
        level = arguments[0] if len(arguments) == 1 else None
        if isinstance(level, bool) or not isinstance(level, int | float) or math.isnan(level):
            raise OscRequestError("the argument has to be one number, a level in dB")
        if level > LOUDEST_DB:
            raise OscRequestError(f"{level:.4g} dB is above the highest level, {LOUDEST_DB:g} dB")
        action(float(level))

    return handle


def number_handler(action: Callable[[float], object]) -> Handler:
    """Handle a finite number: pass it to `action`."""

    def handle(arguments: Sequence[object]) -> None:
        argument = arguments[0] if len(arguments) == 1 else None
        try:
            number = float(argument) if isinstance(argument, int | float) else math.nan
        except OverflowError:
            number = math.nan
        if isinstance(argument, bool) or not math.isfinite(number):
            raise OscRequestError("the argument has to be one finite number; 1 is full scale")
        action(number)

    return handle


def text_handler(action: Callable[[str], object]) -> Handler:
    """Handle a text: pass it to `action`."""

    def handle(arguments: Sequence[object]) -> None:
        line = arguments[0] if len(arguments) == 1 else None
        if not isinstance(line, str) or len(line) > _COMMAND_LENGTH_MAX:
            raise OscRequestError(
                f"the argument has to be one string of at most {_COMMAND_LENGTH_MAX} characters"
            )
        action(line)

    return handle


def _shared_key_handler(player: str) -> Handler:
    def refuse(_arguments: Sequence[object]) -> None:
        raise OscRequestError(
            f"every instrument of {player}'s key is shared with other keys: "
            "use /ergon/instrument/NAME/gain"
        )

    return refuse
