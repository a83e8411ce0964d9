"""Notices that come again and again are a line at first, and then a count every ten seconds."""

import re

import pytest

from ergon.live.display import event_sentence
from ergon.live.repeated_notices import REPEATING_EVENT_KINDS, RepeatedNotices

RATE = 48_000.0


def shown(kind: str, count: int, every: float, seconds: float = 0.0) -> list[tuple[int, str]]:
    """The lines of `count` events, one in so many seconds, and of the end."""
    notices, lines = RepeatedNotices(RATE), []
    sentence = event_sentence((0, kind, seconds), ["remi"], ["pad"]) or "the card was late"
    for index in range(count):
        frame = int(index * every * RATE)
        lines += notices.due_lines(frame)
        lines += notices.add_notice(frame, kind, sentence, seconds)
    return lines + notices.last_lines()


def test_notices_of_thousand_thread_stops_summarised() -> None:
    lines = shown("lost", 1159, every=0.05, seconds=0.01)
    assert lines[0] == (0, "the physics thread was stopped for 0.010 s")
    assert len(lines) <= 2 + 1159 * 0.05 / 10
    counts, sums = zip(
        *(
            re.fullmatch(r".* stopped (\d+) times more, for ([\d.]+) s in all", line).groups()  # type: ignore[union-attr]
            for _, line in lines[1:]
        ),
        strict=True,
    )
    assert 1 + sum(map(int, counts)) == 1159
    assert sum(map(float, sums)) == pytest.approx(0.01 * 1158)


@pytest.mark.parametrize("kind", sorted(REPEATING_EVENT_KINDS - {"lost"}))
def test_notices_of_equal_sentences_counted(kind: str) -> None:
    first, *others = (line for _, line in shown(kind, 300, every=0.1))
    assert others
    assert all(line.startswith(f"{first} (") for line in others)
    numbers = [int(line.rsplit("(", 1)[1].split()[0]) for line in others]
    assert 1 + sum(numbers) == 300


def test_notices_of_trips_shown_each_time() -> None:
    for kind in ("tripped: speed", "gone", "back", "took over"):
        assert len(shown(kind, 5, every=0.5)) == 5


def test_notices_of_rare_stops_shown_each_time() -> None:
    lines = shown("lost", 4, every=12.0, seconds=0.02)
    assert [line for _, line in lines] == ["the physics thread was stopped for 0.020 s"] * 4


def test_notices_order_after_pause() -> None:
    notices = RepeatedNotices(RATE)
    notices.add_notice(0, "lost", "stopped", 0.5)
    notices.add_notice(100, "lost", "stopped", 0.5)
    assert notices.due_lines(int(9.9 * RATE)) == []
    assert len(notices.due_lines(int(10.0 * RATE))) == 1
    assert notices.last_lines() == []
