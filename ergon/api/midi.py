"""MIDI ports as options ask for them, and what a session does with each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from ergon.common.report import Report

from .errors import OptionError

if TYPE_CHECKING:
    from ergon import _core
    from ergon.live.midi_ports import InputPort
    from ergon.live.midi_sender import TimedSender
    from ergon.live.osc_out import HearingClock
    from ergon.repl.session.midi_clock import ClockIn
    from ergon.repl.session.session import Session

    from .options import SessionOptions

    Port = TypeVar("Port", InputPort, TimedSender)


@dataclass(frozen=True, slots=True)
class MidiPorts:
    """Open ports: for notes and controllers, for the clock to follow, for the clock to send."""

    inputs: Sequence[InputPort]
    clock_input: InputPort | None
    clock_output: TimedSender | None


def midi_ports(options: SessionOptions, report: Report) -> MidiPorts:
    """Open the ports that are asked for. Raises OptionError, and then none stays open."""
    from ergon.live.midi_ports import MidiError, SystemInput
    from ergon.live.midi_sender import TimedSender

    opened_ports: list[InputPort | TimedSender] = []

    def open_port(
        option_name: str, port_name: str, open_system_port: Callable[[str], Port]
    ) -> Port:
        try:
            open_port = open_system_port(port_name)
        except MidiError as error:
            for opened_port in opened_ports:
                opened_port.close()
            raise OptionError(option_name, str(error), value=port_name) from None
        opened_ports.append(open_port)
        return open_port

    midi_inputs = [open_port("midi", name, SystemInput) for name in options.midi]
    clock_input = options.midi_clock_from and open_port(
        "midi_clock_from", options.midi_clock_from, SystemInput
    )
    clock_output = options.midi_clock_to and open_port(
        "midi_clock_to", options.midi_clock_to, TimedSender
    )
    for midi_input in midi_inputs:
        report.say(f"MIDI is heard from {midi_input.name}")
    if clock_input:
        report.say(f"the MIDI clock of {clock_input.name} is followed")
    if clock_output:
        report.say(f"MIDI clock goes to {clock_output.name}")
    return MidiPorts(midi_inputs, clock_input or None, clock_output or None)


def attach_midi(session: Session, performance: _core.Performance, ports: MidiPorts) -> None:
    """Connect the ports to a session, until it ends."""
    from ergon.live.osc_out import HearingClock
    from ergon.repl.session.midi_clock import ClockIn, ClockOut

    for port in ports.inputs:
        session.attach(port)
        session.midi.inputs.append(port.name)
        port.listen(session.midi.receive)
    if ports.clock_output is not None:
        session.attach(ClockOut(session.schedule, performance, ports.clock_output))
    if ports.clock_input is not None:
        hearing_clock = HearingClock(session.schedule.rate, 0)
        clock = ClockIn(session, hearing_clock.instant_of, ports.clock_input)
        session.attach(clock, partial(_follow_clock, hearing_clock, clock, performance))


def _follow_clock(
    hearing_clock: HearingClock, clock: ClockIn, performance: _core.Performance, instant_now: float
) -> None:
    hearing_clock.update(performance.status(), instant_now)
    clock.follow(instant_now)
