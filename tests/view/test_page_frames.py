"""Frames of a file in a real browser, beside the engine's reader; and what the page says."""

from __future__ import annotations

import wave
from collections.abc import Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
from motions import Piece
from patience import until

from ergon import _core
from ergon.cli import app

PIECE = Piece()
# A cloth that a stone tears, a pendulum whose rope is stiff, a string that is struck late, and a
# bell that nothing strikes before 1.5 s and whose decay is fast.
SCENE = """\
ergon: 1
instruments:
  cloth:
    space: 3
    gravity: 9.81m/s2
    modules:
      net: {CLOTH: {sides: [7, 6], M: 50g, at: [0, 0, 60cm], across: [34cm, 0, 0],
        up: [0, 0, 26cm], K: 500N/m, Z: 0.01Ns/m, held: top, breaks: 3mm}}
      stone: {MAS: {M: 70g, X0: [17cm, 22cm, 72cm], V0: [0, -3.5m/s, 0.5m/s]}}
      hit: {BUT: {between: [stone, net.all], K: 4kN/m, Z: 0.2Ns/m, gap: 25mm}}
      nail: {SOL: {X0: [1m, 0, 0]}}
      bob: {MAS: {M: 20g, X0: [130cm, 0, 0]}}
      rod: {RES: {between: [nail, bob], K: 3kN/m}}
    out: {threads: {SOV: [net.20.y, bob.z]}}
  s:
    modules: {wire: {STRING: {masses: 12, f: 110Hz, t60: 0.5s, M: 10g, hardening: 1e6}}}
    out: {SOX: wire.all}
  bell:
    modules: {cup: {CEL: {M: 1g, f: 300Hz, t60: 5ms}}}
    out: {SOX: cup}
strikes:
  hit: {to: s.wire.3, at: 1.37s, impulse: 3mNs}
  ring: {to: bell.cup, at: 1.5s, impulse: 1mNs}
render: {tail: 2s}
"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running() as browser_process:
        yield browser_process


def test_page_decodes_engine_motion(
    chromium: browser.Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(SCENE)
    assert app.run(["render", "-q", "scene.yaml", "-o", "a.wav", "--motion", "--see", "all"]) == 0
    file = _core.read_motion("a.motion")
    instants = np.sort(np.random.default_rng(4).uniform(0.0, file.duration, 40))
    wanted = file.displacements(instants.tolist())
    server = _core.ViewServer(tmp_path / "a.motion", key=browser.KEY)
    try:
        with chromium.page(320, 240) as page:
            page.open(f"{server.url}?t=0")
            positions = page.run(
                """((instants) => instants.map((t) => {
                    const { story } = ergon.page, z = new Float32Array(story.model.n).fill(NaN);
                    story.model.parts.forEach((part, i) => {
                      if (part.kind === "sampled" && !story.frames[i].at(t, z, part.first)) throw t;
                    });
                    return Array.from(z, (x) => Number.isNaN(x) ? null : x);
                }))("""
                + repr(instants.tolist())
                + ")"
            )
            # Backwards, and so from before its strike, a bell of a fast decay stands still.
            page.run("ergon.seek(3); ergon.seek(0.5)")
            bell = file.names.index("bell.cup")
            page.run(f"ergon.page.showPoint({bell}, 9, 9); ergon.page.draw()")
            lines = page.run("document.getElementById('point').textContent").split("\n")
            assert page.errors == []
    finally:
        server.close()
    assert "at rest" in lines
    assert not any("?" in line for line in lines)
    read = np.array(positions, dtype=float)
    is_sampled = np.isfinite(read).all(axis=0)
    assert is_sampled.sum() > 100
    assert (np.isfinite(read).any(axis=0) == is_sampled).all()
    moved = wanted[:, is_sampled]
    np.testing.assert_allclose(read[:, is_sampled], moved, rtol=1e-6, atol=1e-9)
    assert (np.ptp(moved, axis=0) > 1e-6).sum() > 50


def test_page_text_of_very_large_exaggeration(chromium: browser.Browser, tmp_path: Path) -> None:
    """Of a part whose displacements are too small to be seen, and of one that moves by 1 nm."""
    server = _core.ViewServer(PIECE.write(tmp_path / "a.motion"), key=browser.KEY)
    try:
        with chromium.page(320, 240) as page:
            page.open(f"{server.url}?t=1")
            page.run("ergon.page.story.peaks.fill(0); ergon.page.story.largest.fill(0)")
            peaks = "ergon.page.story.peaks.set([2e-26, 2e-9], 0); ergon.page.draw()"
            page.run(f"ergon.page.camera.distance = 4; {peaks}")
            words = page.run(
                "[0, 1].map((i) => ergon.page.labels.words("
                "ergon.page.story.model.parts[i], ergon.page.motion, i))"
            )
    finally:
        server.close()
    assert words[0] == "sky ×1"
    assert words[1] == "wire ×5·10⁷"


# The page gets its sound only when `letSound` is called.
LATE_SOUND = """
  const loads = window.fetch;
  const isLet = new Promise((resolve) => (window.letSound = resolve));
  window.fetch = async (what) => {
    if (what === "sound.wav") await isLet;
    return loads(what);
  };
"""


@pytest.mark.parametrize("presses", [0, 2])
def test_page_keys_while_sound_loads(
    chromium: browser.Browser, tmp_path: Path, presses: int
) -> None:
    """Space runs and then stops it: so it stands when the sound is there; else it begins to run."""
    sound = tmp_path / "a.wav"
    with wave.open(str(sound), "wb") as file:
        file.setparams((1, 2, 8000, 0, "NONE", ""))
        file.writeframes(bytes(2 * 8000 * 4))
    motion = PIECE.write(tmp_path / "a.motion")
    server = _core.ViewServer(motion, sound=sound, key=browser.KEY)
    try:
        with chromium.page(320, 240) as page:
            page.call("Page.addScriptToEvaluateOnNewDocument", source=LATE_SOUND)
            page.call("Page.navigate", url=f"{server.url}?sound")
            until(lambda: page.run("Boolean(window.ergon?.page?.story.duration === 4)"), "motion")
            until(lambda: page.run("document.title") == "Example: view", "the first picture")
            page.press("Home")
            for _ in range(presses):
                page.press("ArrowRight")
                page.press(" ")
            if presses:
                assert not page.run("ergon.page.clock.runs")
                assert page.run("ergon.page.clock.t") >= 2.0
            assert not page.run("ergon.page.sound.isThere")
            page.run("letSound(); ergon.ready.then(() => true)")
            assert page.run("ergon.page.sound.isThere")
            assert page.run("ergon.page.clock.runs") == (presses == 0)
            if presses:
                assert page.run("ergon.page.clock.t") >= 2.0
            assert page.errors == []
    finally:
        server.close()
