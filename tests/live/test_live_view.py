"""Pages that see what is played, by the commands and in a real browser."""

import json
import re
import urllib.parse
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import browser
import pytest
from commands import forked
from duets import played, recorded
from emulators import emulator
from one_bell import SCORE
from patience import until

from ergon.api.options import PlayOptions
from ergon.api.play import begin, prepare
from ergon.common.report import Report
from tests.live.test_duet_lockstep import COUPLED, written
from tests.repl.test_repl_live import ok, session_on

SKY = """\
ergon: 1
title: Sky
instruments:
  sky: {BANK: {count: 60, f: 30Hz..2kHz, t60: 3s, M: 1g}, out: {SOX: sky.all}}
  wire: {STRING: {masses: 24, f: 110Hz, t60: 3s, M: 10g}, out: {SOX: wire.3}}
  dark: {STRING: {masses: 12, f: 110Hz, t60: 3s, M: 10g}}
strikes:
  rain: {to: sky.all, at: 0s, for: 600s, rate: 0.5Hz, impulse: -1uNs..1uNs}
  pluck: {to: wire.9, at: 0s, every: 1s, times: 600, impulse: 1mNs}
  unheard: {to: dark.3, at: 0s, every: 1s, times: 600, impulse: 1mNs}
mix: {channels: 2, route: [{from: sky, to: [1, 2]}, {from: wire, to: 1}]}
"""
TORN = """\
ergon: 1
instruments:
  w:
    space: 3
    modules:
      nail: {SOL: {X0: [0, 0, 0]}}
      ball: {MAS: {M: 1kg, X0: [10cm, 0, 0], V0: [0.4m/s, 0, 0]}}
      other: {MAS: {M: 1kg, X0: [0, 0, 10cm], V0: [0, 0, 0.1m/s]}}
      thread: {REF: {between: [nail, ball], K: 1kN/m, breaks: 8mm}}
      rope: {REF: {between: [nail, other], K: 1kN/m, breaks: 8mm}}
    out: {x: {SOX: ball.x}, z: {SOX: other.z}}
render: {tail: 600s}
"""
# What a page knows of what is heard: whether a clock says it, how far its picture is from that.
LIVE_CLOCK = """(() => { const {live, clock, story} = ergon.page;
  const there = live.at(performance.now() / 1000, story.end);
  return [live.heard !== null, there - clock.t, clock.t]; })()"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running() as found:
        yield found


def test_view_leaves_sound_unchanged(work_folder: Path) -> None:
    """A performance with and without pages, into a file."""
    Path("s.yaml").write_text(SCORE)
    common = ("play", "s.yaml", "--gain", "0dB", "--audio")
    plain = forked([*common, "file:plain.wav"], work_folder)
    assert plain.returncode == 0, plain.stderr
    for name, options in {
        "seen": ("--view",),
        "all": ("--view-at", "127.0.0.1:0", "--see", "all"),
    }.items():
        seen = forked([*common, f"file:{name}.wav", *options], work_folder)
        assert seen.returncode == 0, seen.stderr
        assert re.search(
            r"^seen at http://127\.0\.0\.1:\d+/[0-9a-f]{32}/$", seen.stderr, re.MULTILINE
        )
        listened = Path("plain.wav").read_bytes()
        assert len(listened) > 100_000
        assert Path(f"{name}.wav").read_bytes() == listened


def test_view_leaves_lockstep_duet_unchanged(work_folder: Path) -> None:
    """A real key in another process: what it does, and what is heard."""
    rate = 6000
    head, tick = f"rates: {{audio: {rate}Hz}}", f", tick: {rate}Hz"
    score = written(work_folder, head=head, tick=tick, duet=COUPLED)
    result = []
    for name, options in {"plain": (), "seen": ("--view",)}.items():
        take, listened = Path(f"{name}.take"), Path(f"{name}.wav")
        with emulator("frame", "--pty", "--lockstep", "--rate", f"{rate}Hz") as device:
            live = ("--live", f"remi={device.url}&wide", "--record", take, "--gain", "0dB")
            text = played(score, *live, "--audio", f"file:{listened}", *options)
        assert any("seen at http://" in line for line in text) == bool(options)
        result.append((listened.read_bytes(), recorded(take).positions().tobytes()))
    assert len(result[0][1]) > rate
    assert result[0] == result[1]


def test_wrong_view_options_are_refused_before_sound(work_folder: Path) -> None:
    Path("s.yaml").write_text(SCORE)
    for options, words in {
        ("--see", "all"): "--see: this needs a page; add the option view",
        ("--view-at", "127.0.0.1"): "write HOST:PORT",
        ("--view-at", "elsewhere.invalid:80"): "write HOST:PORT",
    }.items():
        refused = forked(["play", "s.yaml", "--audio", "null", *options], work_folder)
        assert refused.returncode == 2
        assert words in refused.stderr


def test_view_on_other_address_has_key_in_url(work_folder: Path) -> None:
    Path("s.yaml").write_text(SCORE)
    words = [
        "play",
        "s.yaml",
        "--gain",
        "0dB",
        "--audio",
        "file:a.wav",
        "--view-at",
        "0.0.0.0:0",
        "--json",
    ]
    output = [json.loads(line) for line in forked(words, work_folder).stdout.splitlines()]
    (url,) = (one["url"] for one in output if one["event"] == "view")
    assert len(bytes.fromhex(urllib.parse.urlsplit(url).path.strip("/"))) == 16


@pytest.mark.slow
def test_view_page_follows_playback_and_seeks(chromium: browser.Browser, work_folder: Path) -> None:
    """By the clock of a card that is none; the page stands, goes back and comes to now again."""
    Path("s.yaml").write_text(SKY)
    options = PlayOptions(audio="null", gain="0dB", ahead=4096, view=True)
    ready = prepare("s.yaml", options, Report())
    pages = ready.config.pages
    assert pages is not None
    performance = begin(ready.stage, ready.config, Report())
    try:
        with chromium.page() as page:
            page.open(pages.server.url)
            assert page.run("document.title") == "Sky: view"
            parts = page.run("ergon.page.story.model.parts.map((p) => [p.name, p.kind, p.count])")
            assert [name for name, *_ in parts] == ["sky", "wire", "dark"]
            assert parts[0][1:] == ["free", 60]
            assert parts[2][1] == "none"
            until(lambda: page.run(LIVE_CLOCK)[0], "a clock")
            until(
                lambda: abs(page.run(LIVE_CLOCK)[1]) < 1 / 60, "the picture is where the sound is"
            )
            # Strikes are known before they are heard, and what they did is drawn.
            until(lambda: page.run("ergon.page.story.ergons.count") > 20, "ergons")
            until(lambda: page.run("ergon.page.motion.sweep.some((x) => x > 0)"), "it swings")
            page.press(" ")
            stands = page.run(LIVE_CLOCK)[2]
            until(lambda: page.run("ergon.page.story.end") > stands + 6, "it is played on")
            # What is long past is forgotten, however long one looks at it.
            assert page.run("ergon.page.story.end - ergon.page.story.begins") < 7
            assert page.run("ergon.page.story.flights.states.length") <= 8
            until(lambda: page.run("ergon.page.clock.t >= ergon.page.story.begins"), "it is drawn")
            page.press("End")
            until(lambda: abs(page.run(LIVE_CLOCK)[1]) < 1 / 60, "now again")
            page.press("ArrowLeft")
            assert page.run("ergon.page.live.isNow") is False
            page.press("-")
            page.press("=")
            page.press("End")
            until(lambda: abs(page.run(LIVE_CLOCK)[1]) < 1 / 60, "now again")
            assert page.errors == []
        tally = pages.server.tally
        assert tally["dropped"] == 0
    finally:
        performance.stop()
        performance.close(1.0)
        pages.close()


@pytest.mark.slow
def test_view_page_opened_late_hides_broken_springs(
    chromium: browser.Browser, work_folder: Path
) -> None:
    """One page sees the thread tear; another comes when the first has forgotten that instant."""
    Path("s.yaml").write_text(TORN)
    options = PlayOptions(audio="null", gain="0dB", view=True)
    ready = prepare("s.yaml", options, Report())
    pages = ready.config.pages
    assert pages is not None
    performance = begin(ready.stage, ready.config, Report())
    # Of each spring, by its first pair of coordinates, whether it is drawn now.
    drawn = """(({story, clock}) => {
      const {links} = story.model, since = story.breaks.all(links.length / 2);
      return [0, 3].map((at) => clock.t < since[at]); })(ergon.page)"""
    try:
        with chromium.page() as page:
            page.open(pages.server.url)
            until(lambda: page.run("ergon.page.story.breaks.since.size") == 1, "it tears")
            until(lambda: page.run("ergon.page.story.begins") > 1, "that is long past")
        with chromium.page() as page:
            page.open(pages.server.url)
            assert page.run("ergon.page.story.model.links.length") == 12
            assert page.run(drawn) == [False, True]
            assert page.errors == []
    finally:
        performance.stop()
        performance.close(1.0)
        pages.close()


def test_view_page_clock_pulled_to_playback(chromium: browser.Browser, work_folder: Path) -> None:
    """Instants that the test writes: no clock is asked."""
    Path("s.yaml").write_text(SKY)
    ready = prepare("s.yaml", PlayOptions(audio="null", gain="0dB", view=True), Report())
    pages = ready.config.pages
    assert pages is not None
    with chromium.page() as page:
        page.call("Page.navigate", url=pages.server.url)
        until(lambda: page.run("!!window.ergon"), "the page's script")
        result = page.run("""import('./live.js').then(({ Live }) => {
          let offset = null;
          const alignment = { ahead: 0 };
          const live = new Live(() => offset, alignment);
          const told = [live.at(7, 3)];
          const word = new DataView(new ArrayBuffer(16));
          word.setFloat64(0, 100.5, true);
          word.setFloat64(8, 1, true);
          live.take(20, word);
          told.push(live.at(7, 3));
          offset = 94; // the server's clock says 101 where the page's says 7
          told.push(live.at(7, 3), live.follow(20.47, 0.02, 7, 3), live.follow(12, 0.02, 7, 3));
          alignment.ahead = 0.04;
          told.push(live.at(7, 3));
          return told;
        })""")
    assert result == pytest.approx([3, 3, 20.5, 20.491, 20.5, 20.54])
    pages.close()


def test_view_page_redraws_after_score_change(chromium: browser.Browser, work_folder: Path) -> None:
    """A session, whose page is open all the time."""
    from ergon.api.options import SessionOptions
    from ergon.api.pages import pages_of

    pages = pages_of(SessionOptions(view=True), Report())
    assert pages is not None
    key = "ergon.page.story.model.parts.findIndex((p) => p.name === 'k1')"
    with closing(session_on(work_folder, "null", pages=pages)) as session, chromium.page() as page:
        page.open(pages.server.url)
        page.run("window.before = ergon.page.story.model")
        page.run(f"ergon.page.look.seen[{key}] = 0")
        ok(session, "play")
        ok(session, "couple k1 k2 K=40N/m Z=0.2Ns/m")
        new = "ergon.page.story.model !== window.before && ergon.page.story.isBegun"
        until(lambda: page.run(new), "a new picture")
        # What was chosen for a part holds for the part of that name.
        assert page.run(f"ergon.page.look.seen[{key}]") == 0
        assert page.run("ergon.page.look.seen.filter((seen) => seen === 0).length") == 1
        assert page.errors == []
