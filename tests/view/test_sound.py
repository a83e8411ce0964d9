"""The sound of the page: it plays with the picture, and the picture follows it."""

from __future__ import annotations

import wave
from collections.abc import Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
from motions import SECONDS, Piece
from patience import until

from ergon import _core

RATE = 8000
_FAR = 0.1  # [s] that sound.js lets the picture be away


def tone(path: Path, seconds: float, channels: int = 1) -> Path:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(channels)
        file.setsampwidth(2)
        file.setframerate(RATE)
        samples = 3000 * np.sin(0.3 * np.arange(int(seconds * RATE)))
        file.writeframes(np.repeat(samples, channels).astype("<i2").tobytes())
    return path


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Piece().write(tmp_path_factory.mktemp("motion") / "example.motion")


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running("--autoplay-policy=no-user-gesture-required") as found:
        yield found


@pytest.fixture
def page(chromium: browser.Browser, motion: Path, tmp_path: Path) -> Iterator[browser.Page]:
    server = _core.ViewServer(motion, sound=tone(tmp_path / "a.wav", SECONDS + 20), key=browser.KEY)
    try:
        with chromium.page() as page:
            page.open(f"{server.url}?sound&t=0.5")
            yield page
            assert page.errors == []
    finally:
        server.close()


AUDIO = "ergon.page.sound.audio"


def sounds(page: browser.Page) -> bool:
    return page.run("ergon.page.sound.sounds")


def test_page_sound_follows_running_picture(page: browser.Page) -> None:
    assert page.run(f"{AUDIO}.duration") == pytest.approx(SECONDS + 20)
    assert not sounds(page)
    page.press(" ")
    until(lambda: page.run(f"{AUDIO}.currentTime") > 0.6, "sound")
    # As in every picture: in one go, so that no time passes between them.
    away = page.run(
        "(() => { const {sound, clock} = ergon.page; sound.follow(clock);"
        " return sound.sounds ? Math.abs(sound.audio.currentTime - clock.t) : 0; })()"
    )
    assert away <= _FAR
    page.press(" ")
    until(lambda: not sounds(page), "silence")


def test_page_sound_seeks_and_silent_in_slow_time(
    page: browser.Page,
) -> None:
    page.press(" ")
    until(lambda: sounds(page), "sound")
    page.run("ergon.page.seek(1.25)")
    until(lambda: page.run(f"{AUDIO}.currentTime") >= 1.25, "the place")
    page.press("-")
    until(lambda: not sounds(page), "silence")
    assert page.run("ergon.page.clock.runs")
    page.press("=")
    page.run("ergon.page.seek(0)")
    until(lambda: sounds(page), "sound")
    page.press("l")
    until(lambda: not sounds(page), "silence")
    assert "no sound" in page.run("document.getElementById('bar').textContent")


def test_page_sound_in_loop(page: browser.Page) -> None:
    page.run("{ const {clock} = ergon.page; clock.loop = [0.2, 0.7]; ergon.page.play(true); }")
    listened: set[int] = set()

    def went_back() -> bool:
        listened.add(int(10 * page.run(f"{AUDIO}.currentTime")))
        return min(listened) <= 4 < max(listened) and page.run(f"{AUDIO}.currentTime") < 0.7 + _FAR

    page.run("ergon.page.seek(0.5)")
    until(went_back, "the loop")


def test_page_sound_after_refused_autoplay(motion: Path, tmp_path: Path) -> None:
    flag = "--autoplay-policy=document-user-activation-required"
    server = _core.ViewServer(motion, sound=tone(tmp_path / "a.wav", SECONDS), key=browser.KEY)
    try:
        with (
            browser.running(flag) as strict,
            strict.page() as page,
        ):
            page.open(f"{server.url}?sound&t=0.1")
            page.run("ergon.page.play(true)")
            words = "document.getElementById('told').textContent"
            until(lambda: "Press a key or click" in page.run(words), "the words")
            page.run("ergon.page.seek(0)")
            page.press("t")
            page.run("ergon.page.play(true)")
            until(lambda: sounds(page) and page.run(words) == "", "sound")
    finally:
        server.close()


def test_page_with_unplayable_sound(
    chromium: browser.Browser, motion: Path, tmp_path: Path
) -> None:
    (tmp_path / "a.wav").write_bytes(b"no sound at all")
    for sound, words in ((tmp_path / "a.wav", "cannot be played"), (None, "(404)")):
        server = _core.ViewServer(motion, sound=sound, key=browser.KEY)
        try:
            with chromium.page() as page:
                page.open(f"{server.url}?sound&t=0.1")
                assert words in page.run("document.getElementById('told').textContent")
                page.run("ergon.page.play(true)")
                until(lambda page=page: page.run("ergon.page.clock.t") > 0.1, "the picture")
        finally:
            server.close()
