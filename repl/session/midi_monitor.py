"""Prints incoming MIDI messages, and counts those without a map."""

from __future__ import annotations

from collections import Counter, deque
from typing import TYPE_CHECKING

from ergon.live.midi_messages import (
    ControlChange,
    NoteOff,
    NoteOn,
    PitchWheel,
    PlayedMessage,
    Pressure,
    ProgramChange,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

_LINES_MAX = 10  # messages printed in a period; the others are counted
_PERIOD_SECONDS = 0.5  # [s]
_WAITING_MAX = 2000  # messages in a period; older ones are dropped
_NOTE_NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")
_SHOWN_SOURCES_MAX = 8  # kinds of messages in one line


class MidiMonitor:
    """The messages that came. Any thread may `note` one; that takes some microseconds."""

    def __init__(self) -> None:
        """Begin without messages, and print none."""
        self.is_on = False
        self._unmapped_counts: Counter[str] = Counter()
        self._waiting_lines: deque[tuple[str, str]] = deque(maxlen=_WAITING_MAX)
        self._period_end = 0.0  # [s] end of the present period
        self._n_lines_left = _LINES_MAX
        self._omitted_counts: Counter[str] = Counter()

    def note(self, message: PlayedMessage, channel: int, *, is_mapped: bool) -> None:
        """Note a message of a channel from 1 to 16."""
        message_source = source_of(message)
        if not is_mapped and not isinstance(message, NoteOff):
            self._unmapped_counts[message_source] += 1
        if self.is_on:
            unmapped_text = "" if is_mapped or isinstance(message, NoteOff) else ", not mapped"
            text = f"MIDI {_message_text(message)}, channel {channel}{unmapped_text}"
            self._waiting_lines.append((message_source, text))

    def due_lines(self, instant_now: float) -> Sequence[str]:
        """The lines to print at an instant [s]: a bounded number each half second, and the
        number of the others.
        """
        monitor_lines = []
        if instant_now >= self._period_end:
            if self._omitted_counts:
                n_omitted = self._omitted_counts.total()
                monitor_lines.append(
                    f"MIDI {n_omitted:,} more: {_counts_text(self._omitted_counts)}"
                )
            self._omitted_counts.clear()
            self._period_end, self._n_lines_left = instant_now + _PERIOD_SECONDS, _LINES_MAX
        while self._waiting_lines:
            message_source, monitor_text = self._waiting_lines.popleft()
            if self._n_lines_left:
                self._n_lines_left -= 1
                monitor_lines.append(monitor_text)
            else:
                self._omitted_counts[message_source] += 1
        return monitor_lines

    def unmapped_line(self) -> str | None:
        """A line on the messages without a map; None if there were none."""
        counts = Counter(dict(self._unmapped_counts))  # another thread may count on meanwhile
        return f"not mapped: {_counts_text(counts)}" if counts else None


def source_of(message: PlayedMessage) -> str:
    """What a message comes from, as a map names it."""
    match message:
        case NoteOn(source_number) | NoteOff(source_number):
            return f"note {source_number}"
        case ControlChange(source_number):
            return f"cc {source_number}"
        case PitchWheel():
            return "bend"
        case ProgramChange(source_number):
            return f"program {source_number}"
        case Pressure(_, source_number):
            return "pressure" if source_number is None else f"pressure {source_number}"


def _message_text(message: PlayedMessage) -> str:
    match message:
        case NoteOn(message_number, velocity):
            return f"note {message_number} ({_note_name(message_number)}), velocity {velocity}"
        case NoteOff(message_number):
            return f"note {message_number} ({_note_name(message_number)}) ends"
        case ControlChange(message_number, message_value):
            return f"cc {message_number} at {message_value}"
        case PitchWheel(message_value):
            return f"bend at {message_value}"
        case ProgramChange(message_number):
            return f"program {message_number}"
        case Pressure(message_value, message_number):
            return (
                f"pressure at {message_value}"
                if message_number is None
                else f"pressure {message_number} at {message_value}"
            )


def _note_name(number: int) -> str:
    """The name of a note: 60 is C4."""
    return f"{_NOTE_NAMES[number % 12]}{number // 12 - 1}"


def _counts_text(counts: Counter[str]) -> str:
    """`cc 22 (14 times), note 35`, those that came most first."""
    source_texts = [
        source if count == 1 else f"{source} ({count:,} times)"
        for source, count in counts.most_common()
    ]
    others_text = (
        f", and {len(source_texts) - _SHOWN_SOURCES_MAX} others"
        if len(source_texts) > _SHOWN_SOURCES_MAX
        else ""
    )
    return ", ".join(source_texts[:_SHOWN_SOURCES_MAX]) + others_text
