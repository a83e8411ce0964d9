"""Keys that are played without a device: their fingers, and the sources that lead them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

from ergon import _core

from .boards import PAGE_KINDS, Board, BoardError
from .led_address import LedAddress, LedKey, is_led, parse_led_address
from .led_gamepad import GamepadAxis, GamepadPort, pad_path
from .led_sources import MidiValues, OscPort, OscValues, open_midi_input
from .midi_ports import VIRTUAL, InputPort, SystemInput

if TYPE_CHECKING:
    from collections.abc import Iterator

_NO_KEYS: Mapping[str, LedKey] = {}
_TRACED_RATE = 1100  # ticks a second, or a little more
_FAST_HAND_ACCELERATION = 10.0  # [m/s²], for which a path's error is stated


class _Source(Protocol):
    def close(self) -> None:
        """Pass on nothing any more."""


@dataclass(frozen=True, slots=True)
class LedHands:
    """Boards with their leads, and the open sources of positions."""

    boards: Sequence[Board] = ()
    sources: Sequence[_Source] = ()
    sentences: Sequence[str] = field(default_factory=tuple)  # about what is open

    @property
    def page_leads(self) -> list[_core.Lead]:
        """The leads of keys that pages play."""
        return [
            board.lead
            for board in self.boards
            if board.lead is not None and board.kind in PAGE_KINDS
        ]

    def close(self) -> None:
        """Stop leading the fingers."""
        for source in self.sources:
            source.close()
        for board in self.boards:
            if board.lead is not None:
                board.lead.close()

    def summaries(self) -> Iterator[str]:
        """A sentence for each led key about its path: rate, latency, error."""
        for board in self.boards:
            if board.lead is not None:
                yield summary(board, board.lead)


def open_led_hands(
    boards: Sequence[Board],
    keys: Mapping[str, LedKey] = _NO_KEYS,
    make_midi: Callable[[str], InputPort] = SystemInput,
) -> LedHands:
    """Open what leads the fingers on keys without a device; other boards stay as they are.

    `keys` has the keys of players; others have the usual one. Raises BoardError, and then nothing
    stays open.
    """
    players = {board.url: player for board in boards for _, player in board.axes}
    addresses = {board.url: parse_led_address(board.url) for board in boards if is_led(board.url)}
    leads: dict[str, _core.Lead] = {}
    led_sources: list[_Source] = []
    sentences: list[str] = []
    try:
        for url, address in addresses.items():
            leads[url] = _make_lead(url, address, keys.get(players[url], LedKey()))
        for port, osc_listeners in _osc_listeners(addresses, leads).items():
            osc = OscPort(port)
            led_sources.append(osc)
            for listener in osc_listeners:
                osc.add(listener)
            osc.begin()
            paths = ", ".join(listener.path for listener in osc_listeners)
            sentences.append(f"positions of {paths} are taken from OSC at 127.0.0.1:{osc.port}")
        for input_name, listeners in _midi_listeners(addresses, leads).items():
            midi_input = open_midi_input(input_name or VIRTUAL, listeners, make_midi)
            led_sources.append(midi_input)
            sentences.append(f"positions are taken from the MIDI input {midi_input.name}")
        for input_name, axes in _gamepad_axes(addresses, leads).items():
            path = pad_path(input_name)
            gamepad_port = GamepadPort(path, axes)
            led_sources.append(gamepad_port)
            rumble_text = ", which rumbles with the force" if gamepad_port.has_rumble else ""
            sentences.append(f"positions are taken from the gamepad {path}{rumble_text}")
    except BoardError:
        for source in (*led_sources, *leads.values()):
            source.close()
        raise
    led_boards = [replace(board, lead=leads.get(board.url)) for board in boards]
    return LedHands(led_boards, led_sources, sentences)


def _make_lead(url: str, address: LedAddress, led_key: LedKey) -> _core.Lead:
    finger, travel = address.finger, led_key.travel
    if address.travel is not None:
        travel = (-0.5 * address.travel, 0.5 * address.travel)
    try:
        return _core.Lead(
            url,
            finger=(finger.stiffness, finger.damping, finger.mass),
            delay=address.delay,
            range=travel,
            spring=(led_key.stiffness, led_key.rest_position),
            lockstep=address.lockstep,
            traced_ticks=int(address.trace * _TRACED_RATE),
            present=address.kind not in PAGE_KINDS,
        )
    except _core.EngineError as error:
        raise BoardError(str(error)) from None


def _osc_listeners(
    addresses: dict[str, LedAddress], leads: dict[str, _core.Lead]
) -> dict[int, list[OscValues]]:
    """The values of each port; of keys in lockstep none, whose messages a test brings."""
    listeners: dict[int, list[OscValues]] = {}
    for url, address in addresses.items():
        if address.kind == "osc" and not address.lockstep:
            listeners.setdefault(address.port, []).append(OscValues(address, leads[url]))
    return listeners


def _midi_listeners(
    addresses: dict[str, LedAddress], leads: dict[str, _core.Lead]
) -> dict[str, list[MidiValues]]:
    """The values of each input, as `_osc_listeners`."""
    listeners: dict[str, list[MidiValues]] = {}
    for url, address in addresses.items():
        if address.kind == "midi" and not address.lockstep:
            listeners.setdefault(address.source, []).append(MidiValues(address, leads[url]))
    return listeners


def _gamepad_axes(
    addresses: dict[str, LedAddress], leads: dict[str, _core.Lead]
) -> dict[str, list[GamepadAxis]]:
    """The values of each gamepad, as `_osc_listeners`."""
    axes: dict[str, list[GamepadAxis]] = {}
    for url, address in addresses.items():
        if address.kind == "gamepad" and not address.lockstep:
            axes.setdefault(address.source, []).append(GamepadAxis(address, leads[url]))
    return axes


def summary(board: Board, lead: _core.Lead) -> str:
    """What came for a key, how late its path is, and how far from the player's it can be.

    A line between two positions of a path with an acceleration a is at most a·gap²/8 from it, the
    bound of linear interpolation (de Boor, A Practical Guide to Splines, 1978, ch. III).
    """
    tally = lead.tally
    address = parse_led_address(board.url)
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
