"""Notices of a performance that come again and again: the first at once, then how many more."""

from __future__ import annotations

from dataclasses import dataclass

# Kinds of events that may come many times a second. Others, such as trips, are shown each time.
REPEATING_EVENT_KINDS = frozenset({"lost", "muted", "gained", "finer", "sound"})
_PAUSE = 10.0  # [s] of the piece between two lines of one kind


@dataclass(slots=True)
class _NoticeCount:
    """Notices of one kind since the last line: their number, the sum of their amounts [s], and the
    latest.
    """

    line_frame: int
    count: int = 0
    stopped_seconds: float = 0.0
    frame: int = 0
    sentence: str = ""

    def take_line(self) -> tuple[int, str]:
        """The line of the notices since the last line; the count starts again."""
        if self.stopped_seconds:
            words = f"{self.count} times more, for {self.stopped_seconds:.3f} s in all"
            notice_sentence = f"the physics thread was stopped {words}"
        else:
            notice_sentence = f"{self.sentence} ({self.count} times more)"
        self.line_frame, self.count, self.stopped_seconds = self.frame, 0, 0.0
        return self.frame, notice_sentence


class RepeatedNotices:
    """Counts notices that repeat, so that each kind is a line every ten seconds at most."""

    def __init__(self, rate: float) -> None:
        """Count by frames of the piece at `rate` [Hz]."""
        self._pause_frames = int(_PAUSE * rate)
        self._counts_by_key: dict[str, _NoticeCount] = {}

    def add_notice(
        self, frame: int, event_kind: str, sentence: str, stopped_seconds: float = 0.0
    ) -> list[tuple[int, str]]:
        """The lines to show now for a notice of an event: itself, or nothing if it is counted.

        `stopped_seconds` is how long the physics thread was stopped, 0 for other kinds.
        """
        if event_kind not in REPEATING_EVENT_KINDS:
            return [(frame, sentence)]
        count_key = event_kind if stopped_seconds else sentence
        notice_count = self._counts_by_key.get(count_key)
        if notice_count is None or (
            not notice_count.count and frame >= notice_count.line_frame + self._pause_frames
        ):
            self._counts_by_key[count_key] = _NoticeCount(frame)
            return [(frame, sentence)]
        notice_count.count += 1
        notice_count.stopped_seconds += stopped_seconds
        notice_count.frame, notice_count.sentence = frame, sentence
        return self.due_lines(frame)

    def due_lines(self, frame: int) -> list[tuple[int, str]]:
        """The lines of what was counted, for kinds whose last line is ten seconds old."""
        return self._lines(frame - self._pause_frames)

    def last_lines(self) -> list[tuple[int, str]]:
        """The lines of all that was counted, at the end of a performance."""
        return self._lines(None)

    def _lines(self, latest_frame: int | None) -> list[tuple[int, str]]:
        """Lines of the kinds whose last line came at frame `latest_frame` or before; None: of all
        kinds.
        """
        pending_notices = (
            notice_count for notice_count in self._counts_by_key.values() if notice_count.count
        )
        return sorted(
            notice_count.take_line()
            for notice_count in pending_notices
            if latest_frame is None or notice_count.line_frame <= latest_frame
        )
