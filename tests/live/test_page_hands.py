"""Keys that a pointer plays on a page, in a real browser."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import browser
import numpy as np
import pytest
from duets import command_output, duet, recorded, sound
from hands_page import HandsPage
from patience import until

from ergon import _core, scores
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
        return self.lead(player).tally

    def lead(self, player: str) -> _core.Lead:
        boards = self.ready.hands.boards
        (lead,) = [board.pointer for board in boards if board.axes[0][1] == player]
        assert lead is not None
        return lead

    def lifted(self, player: str) -> bool:
        trace = self.lead(player).trace()
        return len(trace) > 0 and bool(np.isnan(trace[-1, 0]))

    def highest(self, player: str) -> float:
        """The highest place of the pointer so far [m]; minus infinity before the first."""
        return float(np.nanmax(self.lead(player).trace()[:, 1], initial=-np.inf))

    def key(self, hand: int) -> float:
        return self.performance.status().hands[hand].position


@contextmanager
def playing(
    record: str | None = None, audio: str = "null", first: str = "page:"
) -> Iterator[Playing]:
    Path("s.yaml").write_text(SCORE.replace("tail: 500ms", "tail: 900s"))
    live = [f"remi={first}?trace=60s", "ada=page:"]
    options = PlayOptions(live=live, record=record, audio=audio, gain="0dB")
    ready = prepare("s.yaml", options, Report())
    performance = begin(ready.stage, ready.config, Report())
    try:
        yield Playing(ready, performance, [])
    finally:
        performance.stop()
        performance.close(10.0)
        ready.close()


def test_page_hand_by_mouse_renders_from_take(chromium: browser.Browser, work_folder: Path):
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
    render = ("render", "s.yaml", "--hands", "hand.take", "--until", end, "--bits", "float")
    code, words = command_output(*render, "-o", "expected.wav")
    assert code == 0, words
    expected = sound(Path("expected.wav"))[: len(played)]
    assert np.max(np.abs(played)) > 1e-4
    assert np.array_equal(played, expected)


@pytest.mark.slow
def test_page_hand_plays_bundled_duet(chromium: browser.Browser, work_folder: Path):
    """As a user does it: the command, its page, a recording, and the render of it, bit for bit."""
    score = Path(scores.__file__).parent / "library" / "duet.yaml"
    arguments = ("--live", "remi=page:", "--record", "hand.take", "--audio", "file:heard.wav")
    # A busy machine takes frames late: what waits for the file may be long.
    more = ("--gain", "0dB", "--ahead", "65536", "--until", "4|1")
    with duet(score, *arguments, *more) as playing, chromium.page(WIDTH, HEIGHT) as page:
        address = re.search(r"http\S+hands\.html", playing.until("hands.html alone"))
        assert address is not None
        hands = HandsPage(page, address[0].removesuffix("hands.html"), lanes=1)
        x, y = hands.middle(0)
        hands.mouse("mousePressed", x, y)
        step = 0
        while playing.process.poll() is None:
            hands.mouse("mouseMoved", x, y - 80 * np.sin(2 * np.pi * step / 60))
            step += 1
        assert page.errors == []
        assert playing.end() == 0, playing.lines
    take = recorded(Path("hand.take"))
    assert np.ptp(take.positions()) > 5e-3
    render = ("render", score, "--hands", "hand.take", "--to", "4|1", "--bits", "float")
    code, words = command_output(*render, "-o", "expected.wav")
    assert code == 0, words
    listened = sound(Path("heard.wav"))[:-FADED]
    assert np.abs(listened).max() > 1e-3
    assert np.array_equal(listened, sound(Path("expected.wav"))[: len(listened)])


def test_page_hand_lane_before_piece_starts(chromium: browser.Browser, work_folder: Path):
    Path("s.yaml").write_text(SCORE)
    live = ["remi=page:", "ada=page:"]
    ready = prepare("s.yaml", PlayOptions(live=live, audio="null", gain="0dB"), Report())
    assert ready.config.pages is not None
    with chromium.page(WIDTH, HEIGHT) as page:
        hands = HandsPage(page, ready.config.pages.server.url)
        hands.mouse("mousePressed", *hands.middle(0))
        until(lambda: hands.sentences()[0] == "remi: waits for the piece", "what it waits for")
        hands.mouse("mouseReleased", *hands.middle(0))
    ready.close()


def test_page_hands_by_two_fingers(chromium: browser.Browser, work_folder: Path):
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


def test_page_hand_closed_page_returns_to_standin(chromium: browser.Browser, work_folder: Path):
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


def test_page_hand_second_page_is_refused(chromium: browser.Browser, work_folder: Path):
    with (
        playing() as piece,
        chromium.page(WIDTH, HEIGHT) as page,
        chromium.page(WIDTH, HEIGHT) as second,
    ):
        hands, others = HandsPage(page, piece.url), HandsPage(second, piece.url)
        hands.show()
        # The pointer is lifted before the page is hidden, which would lift it at any time.
        hands.mouse("mousePressed", *hands.middle(0))
        hands.mouse("mouseReleased", *hands.middle(0))
        until(lambda: piece.tally("remi")["taken"] >= 2, "a position and a lift")
        others.show()
        until(lambda: "another page" in others.sentences()[0], "who plays it")
        taken = piece.tally("remi")["taken"]
        x, y = others.middle(0)
        others.mouse("mousePressed", x, y)
        others.mouse("mouseMoved", x, y - 100)
        until(lambda: piece.tally("remi")["refused"] >= 2, "refused positions")
        assert piece.tally("remi")["taken"] == taken
        others.mouse("mouseReleased", x, y - 100)


def test_page_hand_lanes_on_piece_page(chromium: browser.Browser, work_folder: Path):
    with playing() as piece, chromium.page(900, HEIGHT) as page:
        page.open(piece.url)
        lanes = "document.querySelectorAll('#hands canvas').length"
        until(lambda: page.run(lanes) == 2, "two lanes beside the picture")
        assert page.errors == []


def test_page_hand_by_letter_keys(chromium: browser.Browser, work_folder: Path):
    """A letter pulls the finger to its place in the travel; the next one leads it on."""
    with playing(first="keys:") as piece, chromium.page(WIDTH, HEIGHT) as page:
        hands = HandsPage(page, piece.url)
        hands.letter("keyDown", "KeyL")
        until(lambda: piece.has("took over"), "a hand from the next bar on")
        until(lambda: piece.key(0) > 0.01, "the key above, where the bell pushes it back")
        hands.letter("keyDown", "KeyA")
        until(lambda: piece.key(0) < -0.04, "the key below")
        hands.letter("keyUp", "KeyA")
        until(lambda: piece.key(0) > 0.01, "the letter that is still pressed")
        hands.letter("keyUp", "KeyL")
        until(lambda: piece.lifted("remi"), "a lifted finger")
        # L is the last of nine letters: the middle of the last ninth of the travel.
        assert np.isclose(piece.highest("remi"), 0.1 * (8.5 / 9 - 0.5), atol=1e-6)
        assert page.errors == []


def test_page_hand_ignores_letters_of_other_lane(chromium: browser.Browser, work_folder: Path):
    with playing(first="keys:") as piece, chromium.page(WIDTH, HEIGHT) as page:
        hands = HandsPage(page, piece.url)
        hands.letter("keyDown", "KeyQ")  # of the second lane, which a pointer plays
        hands.letter("keyDown", "KeyG")
        until(lambda: piece.tally("remi")["taken"] > 0, "a position")
        assert piece.tally("ada") == dict.fromkeys(piece.tally("ada"), 0.0)
        hands.choose(1, "letters")
        hands.letter("keyDown", "KeyE")
        until(lambda: piece.tally("ada")["taken"] > 0, "a position of the second lane")


PAD = """
var buttons = Array.from({length: 8}, () => ({value: 0}));
window.pad = {connected: true, timestamp: 0, axes: [0, 0, 0, 0], buttons};
window.hums = [];
pad.vibrationActuator = {playEffect: (_, {strongMagnitude}) => void hums.push(strongMagnitude)};
navigator.getGamepads = () => [null, window.pad];
"""


def test_page_hand_by_gamepad_stick(chromium: browser.Browser, work_folder: Path):
    """The browser's Gamepad API, which a script answers here in place of a gamepad."""

    def push(axis: int, value: float) -> None:
        page.run(f"pad.axes[{axis}] = {value}; pad.timestamp = performance.now(); 0")

    with playing() as piece, chromium.page(WIDTH, HEIGHT) as page:
        hands = HandsPage(page, piece.url)
        page.run(PAD + "0")
        hands.choose(0, "gamepad ly")
        push(1, 0.1)  # a stick that is hardly moved takes no key
        push(1, -0.8)
        until(lambda: piece.has("took over"), "a hand from the next bar on")
        until(lambda: piece.key(0) > 0.01, "pushed away is up")
        push(1, 0.5)
        until(lambda: piece.key(0) < -0.02, "pulled is down")
        push(1, -1.0)  # against the bell
        until(lambda: page.run("Math.max(0, ...hums)") > 0.1, "a hum for the force of the bell")
        assert page.run("Math.max(...hums)") <= 1.0
        piece.events.clear()
        page.run("pad.connected = false; 0")
        until(lambda: piece.has("gone"), "a stand-in for an unplugged gamepad")
        assert page.errors == []
