"""Commands about MIDI that make no new version: maps listed, maps learnt, messages printed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ergon.repl.language.mapping import Learn, Maps, Monitor
from ergon.repl.session import midi_maps
from ergon.repl.session.command_table import executes
from ergon.repl.session_protocol import Reply

if TYPE_CHECKING:
    from ergon.repl.session.core import SessionCore


@executes(Maps)
def _list_maps(session: SessionCore, command: Maps) -> Reply:
    maps = midi_maps.player_maps(session.schedule.head.maps).values()
    map_lines = tuple(midi_map.line.removeprefix("map ") for midi_map in maps)
    if (unmapped_line := session.midi.monitor.unmapped_line()) is not None:
        map_lines = (*map_lines, unmapped_line)
    return Reply(True, "" if map_lines else "ok nothing is mapped", lines=map_lines)


@executes(Learn)
def _learn_map(session: SessionCore, command: Learn) -> Reply:
    learning_text = session.midi.learn(command.map)
    return Reply(
        True, f"ok {learning_text}{'' if command.map is None else _no_input_text(session)}"
    )


@executes(Monitor)
def _switch_monitor(session: SessionCore, command: Monitor) -> Reply:
    session.midi.monitor.is_on = command.is_on
    if not command.is_on:
        return Reply(True, "ok")
    monitor_text = "MIDI is printed as it comes; `monitor off` ends it"
    return Reply(True, f"ok {monitor_text}{_no_input_text(session)}")


def _no_input_text(session: SessionCore) -> str:
    """What a reply adds where no MIDI can come."""
    no_input_text = "; no MIDI input is open: start ergon with --midi PORT"
    return "" if session.midi.inputs else no_input_text
