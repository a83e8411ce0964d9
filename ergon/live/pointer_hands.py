"""Keys that are played without a device: their fingers, and the sources of their pointers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

from ergon import _core

from .boards import PAGE_KINDS, Board, BoardError
from .midi_ports import VIRTUAL, InputPort, SystemInput
from .pointer_address import PointerAddress, PointerKey, is_pointer_driven, parse_pointer_address
from .pointer_gamepad import GamepadAxis, GamepadPort, pad_path
from .pointer_sources import MidiPositionReceiver, OscPort, OscPositionReceiver, open_midi_input

if TYPE_CHECKING:
    from collections.abc import Iterator

_NO_KEYS: Mapping[str, PointerKey] = {}
_TRACED_RATE = 1100  # ticks a second, or a little more
_FAST_HAND_ACCELERATION = 10.0  # [m/s²], for which a path's error is stated


class _Source(Protocol):
    def close(self) -> None:
        """Pass on nothing any more."""


@dataclass(frozen=True, slots=True)
class PointerHands:
    """Boards with their pointers, and the open sources of positions."""

    boards: Sequence[Board] = ()
    sources: Sequence[_Source] = ()
    sentences: Sequence[str] = field(default_factory=tuple)  # about what is open

    @property
    def page_pointers(self) -> list[_core.Lead]:
        """The pointers of keys that pages play."""
        return [
            board.pointer
            for board in self.boards
            if board.pointer is not None and board.kind in PAGE_KINDS
        ]

    def close(self) -> None:
        """Stop pulling the fingers."""
        for source in self.sources:
            source.close()
        for board in self.boards:
            if board.pointer is not None:
                board.pointer.close()

    def summaries(self) -> Iterator[str]:
        """A sentence for each such key about the path of its pointer: rate, latency, error."""
        for board in self.boards:
            if board.pointer is not None:
                yield path_summary(board, board.pointer)


def open_pointer_hands(
    boards: Sequence[Board],
    keys: Mapping[str, PointerKey] = _NO_KEYS,
    make_midi: Callable[[str], InputPort] = SystemInput,
) -> PointerHands:
    """Open the pointers of keys without a device; other boards stay as they are.

    `keys` has the keys of players; others have the usual one. Raises BoardError, and then nothing
    stays open.
    """
    players = {board.url: player for board in boards for _, player in board.axes}
    addresses = {
        board.url: parse_pointer_address(board.url)
        for board in boards
        if is_pointer_driven(board.url)
    }
    pointers: dict[str, _core.Lead] = {}
    open_sources: list[_Source] = []
    sentences: list[str] = []
    try:
        for url, address in addresses.items():
            pointers[url] = _make_pointer(url, address, keys.get(players[url], PointerKey()))
        for port, osc_receivers in _osc_receivers(addresses, pointers).items():
            osc = OscPort(port)
            open_sources.append(osc)
            for listener in osc_receivers:
                osc.add(listener)
            osc.begin()
            paths = ", ".join(listener.path for listener in osc_receivers)
            sentences.append(f"positions of {paths} are taken from OSC at 127.0.0.1:{osc.port}")
        for input_name, listeners in _midi_receivers(addresses, pointers).items():
            midi_input = open_midi_input(input_name or VIRTUAL, listeners, make_midi)
            open_sources.append(midi_input)
            sentences.append(f"positions are taken from the MIDI input {midi_input.name}")
        for input_name, axes in _gamepad_axes(addresses, pointers).items():
            path = pad_path(input_name)
            gamepad_port = GamepadPort(path, axes)
            open_sources.append(gamepad_port)
            rumble_text = ", which rumbles with the force" if gamepad_port.has_rumble else ""
            sentences.append(f"positions are taken from the gamepad {path}{rumble_text}")
    except BoardError:
        for source in (*open_sources, *pointers.values()):
            source.close()
        raise
    boards_with_pointers = [replace(board, pointer=pointers.get(board.url)) for board in boards]
    return PointerHands(boards_with_pointers, open_sources, sentences)


def _make_pointer(url: str, address: PointerAddress, pointer_key: PointerKey) -> _core.Lead:
    finger, travel = address.finger, pointer_key.travel
    if address.travel is not None:
        travel = (-0.5 * address.travel, 0.5 * address.travel)
    try:
        return _core.Lead(
            url,
            finger=(finger.stiffness, finger.damping, finger.mass),
            delay=address.delay,
            range=travel,
            spring=(pointer_key.stiffness, pointer_key.rest_position),
            lockstep=address.lockstep,
            traced_ticks=int(address.traced_seconds * _TRACED_RATE),
            present=address.kind not in PAGE_KINDS,
        )
    except _core.EngineError as error:
        raise BoardError(str(error)) from None


def _osc_receivers(
    addresses: dict[str, PointerAddress], pointers: dict[str, _core.Lead]
) -> dict[int, list[OscPositionReceiver]]:
    """The values of each port; of keys in lockstep none, whose messages a test brings."""
    listeners: dict[int, list[OscPositionReceiver]] = {}
    for url, address in addresses.items():
        if address.kind == "osc" and not address.lockstep:
            listeners.setdefault(address.port, []).append(
                OscPositionReceiver(address, pointers[url])
            )
    return listeners


def _midi_receivers(
    addresses: dict[str, PointerAddress], pointers: dict[str, _core.Lead]
) -> dict[str, list[MidiPositionReceiver]]:
    """The values of each input, as `_osc_receivers`."""
    listeners: dict[str, list[MidiPositionReceiver]] = {}
    for url, address in addresses.items():
        if address.kind == "midi" and not address.lockstep:
            listeners.setdefault(address.source, []).append(
                MidiPositionReceiver(address, pointers[url])
            )
    return listeners


def _gamepad_axes(
    addresses: dict[str, PointerAddress], pointers: dict[str, _core.Lead]
) -> dict[str, list[GamepadAxis]]:
    """The values of each gamepad, as `_osc_receivers`."""
    axes: dict[str, list[GamepadAxis]] = {}
    for url, address in addresses.items():
        if address.kind == "gamepad" and not address.lockstep:
            axes.setdefault(address.source, []).append(GamepadAxis(address, pointers[url]))
    return axes


def path_summary(board: Board, pointer: _core.Lead) -> str:
    """What came for a key, how late its path is, and how far from the player's it can be.

    A line between two positions of a path with an acceleration a is at most a·gap²/8 from it, the
    bound of linear interpolation (de Boor, A Practical Guide to Splines, 1978, ch. III).
    """
    tally = pointer.tally
    address = parse_pointer_address(board.url)
    players = ", ".join(player for _, player in board.axes)
    gap_seconds, deviation = tally["gap"], tally["deviation"]
    count_text = f"{tally['taken']:,.0f} position" + ("" if tally["taken"] == 1.0 else "s")
    arrival_sentence = f"{players} by {board.display_name}: {count_text}"
    if gap_seconds > 0.0:
        arrival_sentence += (
            f", one each {gap_seconds * 1e3:.1f} ms ± {deviation * 1e3:.1f} ms; path "
            f"{address.delay * 1e3:g} ms late and within "
            f"{_FAST_HAND_ACCELERATION * gap_seconds * gap_seconds / 8.0 * 1e3:.2g} mm "
            f"where the hand accelerates by {_FAST_HAND_ACCELERATION:g} m/s²"
        )
    counts = [
        (tally["late"], "too late"),
        (tally["misdated"], "with impossible times"),
        (tally["refused"], "refused"),
    ]
    return "; ".join(
        [
            arrival_sentence,
            *(
                f"{event_count:,.0f} {counted_event}"
                for event_count, counted_event in counts
                if event_count
            ),
        ]
    )
