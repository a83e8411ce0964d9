"""Ports of the system: opened by name, heard, sent to and closed; what fails is one sentence."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ergon.live.midi_ports import MidiError, SystemInput, SystemOutput


class Wire:
    """What connects ports of a system that stands in for the machine's."""

    def __init__(self) -> None:
        self.inputs: dict[str, Callable[[list[int], float, object], None]] = {}
        self.names: list[str] = []
        self.closed: list[str] = []


class Port:
    """One end, with the methods of `supriya_midi.MidiIn` and `MidiOut` that are called."""

    def __init__(self, wire: Wire, system: int) -> None:
        if system == 2:
            raise RuntimeError("no sequencer")
        self.wire = wire
        self.name = ""

    def get_ports(self) -> list[str]:
        return self.wire.names

    def open_virtual_port(self, name: str) -> None:
        self.name = name
        self.wire.names.append(name)

    def open_port(self, number: int, name: str) -> None:
        self.name = self.wire.names[number]

    def ignore_types(self, *, sysex: bool, timing: bool, active_sense: bool) -> None:
        assert (sysex, timing, active_sense) == (True, False, True)

    def set_callback(self, callback: Callable[[list[int], float, object], None]) -> None:
        self.wire.inputs[self.name] = callback

    def cancel_callback(self) -> None:
        self.wire.inputs.pop(self.name, None)

    def send_message(self, message: bytes) -> None:
        if message[0] < 0x80:
            raise ValueError("not a status")
        self.wire.inputs[self.name](list(message), 0.0, None)

    def close_port(self) -> None:
        self.wire.closed.append(f"{self.name} port")

    def delete(self) -> None:
        self.wire.closed.append(f"{self.name} deleted")


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Wire:
    result = Wire()
    module: Any = SimpleNamespace(
        RtMidiAPI=SimpleNamespace(RTMIDI_DUMMY=5),
        RtMidiError=type("RtMidiError", (Exception,), {}),
        get_compiled_apis=lambda: [2, 3, 5],  # ALSA fails, JACK runs, the dummy is passed over
        MidiIn=lambda system, _client: Port(result, system),
        MidiOut=lambda system, _client: Port(result, system),
    )
    monkeypatch.setitem(sys.modules, "supriya_midi", module)
    return result


def test_midi_virtual_input_receives_messages(wire: Wire):
    source = SystemInput("virtual")
    messages: list[bytes] = []
    source.listen(lambda data, _instant: messages.append(data))
    keyboard = SystemOutput("ergon")
    keyboard.send(b"\x90\x3c\x64")
    keyboard.send(b"\x01")  # no message: lost, and nothing else happens
    keyboard.send(b"\xf8")
    assert messages == [b"\x90\x3c\x64", b"\xf8"]
    source.close()
    assert wire.inputs == {}
    assert wire.closed == ["ergon port", "ergon deleted"]


def test_midi_unknown_port_lists_ports(wire: Wire):
    wire.names += ["Keys 1"]
    with pytest.raises(MidiError, match=r"no MIDI input is called 'drum'; there are 'Keys 1'"):
        SystemInput("drum")


def test_midi_without_library_suggests_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "supriya_midi", None)
    with pytest.raises(MidiError, match=r"MIDI needs supriya-midi; install it by: pip install"):
        SystemInput("virtual")


def has_system_midi() -> bool:
    there = sys.platform == "darwin" or Path("/dev/snd/seq").exists()
    return there and importlib.util.find_spec("supriya_midi") is not None


def test_midi_system_loopback():
    if not has_system_midi():
        with pytest.raises(MidiError):
            SystemInput("virtual")
        return
    source = SystemInput("virtual")
    messages: list[bytes] = []
    source.listen(lambda data, _instant: messages.append(data))
    keyboard = SystemOutput("ergon")
    sent = [bytes([0x90, 60 + number, 100]) for number in range(3)]
    for message in sent:
        keyboard.send(message)
    while len(messages) < len(sent):
        time.sleep(0.001)
    keyboard.close()
    source.close()
    assert messages == sent
