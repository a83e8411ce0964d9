"""Keys that a pointer plays on a page, in a real browser."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import browser
import numpy as np
import pytest
from duets import recorded, said, sound
from patience import until

from ergon import _core
from ergon.api.options import PlayOptions
from ergon.api.play import PreparedPlay, begin, prepare
from ergon.common.report import Report
from tests.live.test_led_hands import SCORE

WIDTH, HEIGHT = 420, 520
TICK_FRAMES = 44
FADED = 1000  # frames at the end of a stopped performance, which fades


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running() as program:
        yield program


@dataclass
class Playing:
    """A piece of which two keys wait for pages."""

    ready: PreparedPlay
    performance: _core.Performance
    events: list[str]

    @property
    def url(self) -> str:
        assert self.ready.config.pages is not None
        return self.ready.config.pages.server.url

    def has(self, event: str) -> bool:
        self.events += [what for _, what, _ in self.performance.events()]
        return event in self.events

    def tally(self, player: str) -> dict[str, float]:
        (lead,) = [b.lead for b in self.ready.hands.boards if b.url == f"page:{player}" and b.lead]
        return lead.tally

    def key(self, hand: int) -> float:
        return self.performance.status().hands[hand].position


@contextmanager
def playing(record: str | None = None, audio: str = "null") -> Iterator[Playing]:
    Path("s.yaml").write_text(SCORE.replace("tail: 500ms", "tail: 900s"))
    options = PlayOptions(live=["remi=page:", "ada=page:"], record=record, audio=audio, gain="0dB")
    ready = prepare("s.yaml", options, Report())
    performance = begin(ready.stage, ready.config, Report())
    try:
        yield Playing(ready, performance, [])
    finally:
        performance.stop()
        performance.close(10.0)
        ready.close()


class HandsPage:
    """The page with its lanes."""

    def __init__(self, page: browser.Page, url: str) -> None:
        self.page = page
        self.show()
        page.call("Page.navigate", url=f"{url}hands.html")
        until(lambda: len(self.sentences()) == 2, "two lanes")
        until(lambda: all("stand-in" in text for text in self.sentences()), "a connection")

    def show(self) -> None:
        """Bring it to the front: a browser draws no hidden page."""
        self.page.call("Page.bringToFront")

    def sentences(self) -> list[str]:
        script = "[...document.querySelectorAll('figcaption')].map((it) => it.textContent)"
        texts: list[str] = self.page.run(script)
        return texts

    def middle(self, lane: int) -> tuple[float, float]:
        box = self.page.run(
            f"document.querySelectorAll('#hands canvas')[{lane}].getBoundingClientRect().toJSON()"
        )
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def mouse(self, kind: str, x: float, y: float) -> None:
        self.page.call(
            "Input.dispatchMouseEvent",
            type=kind,
            x=x,
            y=y,
            button="left",
            buttons=0 if kind == "mouseReleased" else 1,
            clickCount=1,
        )

    def touch(self, kind: str, *points: tuple[int, float, float]) -> None:
        rows = [{"id": number, "x": x, "y": y} for number, x, y in points]
        self.page.call("Input.dispatchTouchEvent", type=kind, touchPoints=rows)


def test_a_mouse_plays_a_key_and_its_take_renders_to_what_was_heard(
    chromium: browser.Browser, own_folder: Path
):
    with (
        playing("hand.take", "file:played.wav") as piece,
        chromium.page(WIDTH, HEIGHT) as page,
    ):
        hands = HandsPage(page, piece.url)
        until(lambda: piece.has("gone"), "a stand-in while no page plays")
        x, y = hands.middle(0)
        hands.mouse("mousePressed", x, y)
        until(lambda: piece.has("took over"), "a hand from the next bar on")
        for step in range(120):
            hands.mouse("mouseMoved", x, y - 90 * np.sin(2 * np.pi * step / 40))
        until(lambda: piece.tally("remi")["taken"] >= 100, "positions")
        hands.mouse("mouseMoved", x, y + 120)
        until(lambda: piece.key(0) < -0.015, "the key below")
        assert re.fullmatch(r"remi: \d+\.\d N", hands.sentences()[0])
        hands.mouse("mouseReleased", x, y + 120)
        assert page.errors == []
    take = recorded(Path("hand.take"))
    assert np.ptp(take.positions()[:, 0]) > 0.02
    assert np.max(np.abs(take.positions())) <= 0.05
    played = sound(Path("played.wav"))[:-FADED]
    end = f"{len(take.positions()) * TICK_FRAMES / 44100:.3f}s"
    render = ("render", "s.yaml", "--hands", "hand.take", "--to", end, "--bits", "float")
    code, words = said(*render, "-o", "expected.wav")
    assert code == 0, words
    expected = sound(Path("expected.wav"))[: len(played)]
    assert np.max(np.abs(played)) > 1e-4
    assert np.array_equal(played, expected)


def test_two_fingers_play_two_keys_at_once(chromium: browser.Browser, own_folder: Path):
    with playing() as piece, chromium.page(WIDTH, HEIGHT) as page:
        hands = HandsPage(page, piece.url)
        page.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
        (x, y), (u, v) = hands.middle(0), hands.middle(1)
        hands.touch("touchStart", (1, x, y), (2, u, v))
        until(lambda: piece.has("took over"), "a hand from the next bar on")
        hands.touch("touchMove", (1, x, y - 100), (2, u, v + 100))
        until(lambda: piece.key(0) > 0.01 and piece.key(1) < -0.01, "keys apart")
        hands.touch("touchEnd")
        assert page.errors == []


def test_a_closed_page_leaves_its_key_to_the_stand_in(chromium: browser.Browser, own_folder: Path):
    with playing() as piece:
        with chromium.page(WIDTH, HEIGHT) as page:
            hands = HandsPage(page, piece.url)
            until(lambda: piece.has("gone"), "nobody at first")
            hands.mouse("mousePressed", *hands.middle(0))
            until(lambda: piece.has("took over"), "a hand from the next bar on")
            piece.events.clear()
            page.call("Page.reload")
            until(lambda: piece.has("gone"), "a stand-in while the page is loaded")
            until(lambda: piece.has("took over"), "the page takes back its key")
            piece.events.clear()
        until(lambda: piece.has("gone"), "a stand-in when the page is closed")


def test_another_page_moves_nothing_and_is_told(chromium: browser.Browser, own_folder: Path):
    with (
        playing() as piece,
        chromium.page(WIDTH, HEIGHT) as page,
        chromium.page(WIDTH, HEIGHT) as second,
    ):
        hands, others = HandsPage(page, piece.url), HandsPage(second, piece.url)
        hands.show()
        hands.mouse("mousePressed", *hands.middle(0))
        until(lambda: piece.tally("remi")["taken"] > 0, "a position")
        others.show()
        until(lambda: "another page" in others.sentences()[0], "who plays it")
        taken = piece.tally("remi")["taken"]
        x, y = others.middle(0)
        others.mouse("mousePressed", x, y)
        others.mouse("mouseMoved", x, y - 100)
        until(lambda: piece.tally("remi")["refused"] > 0, "refused positions")
        assert piece.tally("remi")["taken"] == taken
        others.mouse("mouseReleased", x, y - 100)


def test_the_page_of_the_piece_has_the_lanes_too(chromium: browser.Browser, own_folder: Path):
    with playing() as piece, chromium.page(900, HEIGHT) as page:
        page.open(piece.url)
        lanes = "document.querySelectorAll('#hands canvas').length"
        until(lambda: page.run(lanes) == 2, "two lanes beside the picture")
        assert page.errors == []
