"""A shared piece: one file that plays from the disk, in a browser that may ask nobody."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
import soundfile
from motions import Piece
from numpy.typing import NDArray
from one_bell import SCORE
from patience import until
from sweep import few

from ergon import _core
from ergon.api.errors import OptionError
from ergon.api.options import FileOptions
from ergon.api.render import prepare, write
from ergon.api.score import read
from ergon.api.share import check_estimate
from ergon.api.shared_page import shared_page
from ergon.api.viewing import flac_file
from ergon.cli import app
from ergon.cli.bundled import bundled_scores
from ergon.common.report import Report

WIDTH, HEIGHT = 480, 300
RATE = 8000
TITLE = "A knock </script><img src=http://127.0.0.1:9/leak>"
PIXELS = """(() => {
  const {gl} = ergon.page.drawing, w = gl.drawingBufferWidth, h = gl.drawingBufferHeight;
  const a = new Uint8Array(4 * w * h);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, a);
  return Array.from(a);
})()"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running("--autoplay-policy=no-user-gesture-required") as found:
        yield found


def piece_with_sound(folder: Path) -> Path:
    """A motion file of all kinds of parts, and a sound of three tones."""
    motion = Piece().write(folder / "piece.motion")
    t = np.arange(4 * RATE) / RATE
    tones = 0.3 * np.sin(2 * np.pi * np.outer(t, [220.0, 330.0]))
    soundfile.write(folder / "tones.wav", tones, RATE, subtype="PCM_16")
    return motion


def shared(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """A piece of this name as a shared file, and its motion file."""
    monkeypatch.chdir(folder)
    if name == "all-kinds":
        motion = piece_with_sound(folder)
        words = ["share", str(motion), "--sound", "tones.wav"]
    else:
        text = SCORE if name == "bell" else SCORE.replace("title: ", f"title: '{TITLE}' #")
        (folder / "s.yaml").write_text(text)
        assert app.run(["render", "s.yaml", "-o", "s.wav", "--motion"]) == 0
        motion = folder / "s.motion"
        words = ["share", "s.motion" if name == "bell" else "s.yaml"]
    assert app.run([*words, "-o", "piece.html"]) == 0
    return folder / "piece.html", motion


def pixels(page: browser.Page, t: float) -> NDArray[np.uint8]:
    page.run(f"ergon.seek({t!r})")
    return np.array(page.run(PIXELS), np.uint8)


@pytest.mark.parametrize("name", few(["all-kinds", "bell", "title"], ["all-kinds", "title"]))
def test_shared_file_plays_without_network(
    name: str, chromium: browser.Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path, motion = shared(name, tmp_path, monkeypatch)
    with chromium.page(WIDTH, HEIGHT) as page:
        page.open(path.as_uri())
        assert page.run("ergon.page.sound.isThere")
        page.run("ergon.page.play(true)")
        until(lambda: page.run("ergon.page.sound.audio.currentTime") > 0.2, "sound")
        until(lambda: page.run("ergon.page.clock.t") > 0.2, "motion")
        instants = [0.05, 0.9, 0.3]  # forth and back
        drawn = [pixels(page, t) for t in instants]
        schemes = {url.partition(":")[0] for url in page.requests}
        assert page.requests[0] == path.as_uri()
        assert schemes == {"file", "data", "blob"}
        assert sum(url.startswith("file:") for url in page.requests) == 1
        assert page.errors == []
        # The policy of the file refuses what the page itself never asks.
        asked = "fetch('http://127.0.0.1:9/x').then((answer) => answer.status)"
        assert page.run(asked) == 404
        image = "new Promise((done) => { const i = new Image(); i.onerror = () => done('refused');"
        assert page.run(f"{image} i.src = 'http://127.0.0.1:9/x.png'; }})") == "refused"
        assert any("Content Security Policy" in error for error in page.errors)
    server = _core.ViewServer(motion, key=browser.KEY)
    try:
        with chromium.page(WIDTH, HEIGHT) as page:
            page.open(f"{server.url}?t=0")
            served = [pixels(page, t) for t in instants]
    finally:
        server.close()
    for ours, theirs in zip(drawn, served, strict=True):
        assert ours.any()
        assert np.array_equal(ours, theirs)


def embedded(path: Path, name: str) -> bytes:
    text = path.read_text(encoding="utf-8")
    (coded,) = re.findall(rf'id="shared-{name}">([^<]*)<', text)
    return base64.b64decode(coded)


def test_shared_file_holds_motion_and_samples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path, motion = shared("all-kinds", tmp_path, monkeypatch)
    assert embedded(path, "motion") == motion.read_bytes()
    samples, rate = soundfile.read(io.BytesIO(embedded(path, "sound")), dtype="int16")
    wanted, _ = soundfile.read("tones.wav", dtype="int16")
    assert rate == RATE
    assert np.abs(samples.astype(int) - wanted).max() <= 1  # rounded anew
    # The same piece, the same bytes.
    again = path.read_bytes()
    words = ["share", str(motion), "--sound", "tones.wav", "-o", "piece.html"]
    assert app.run(words) == 0
    assert path.read_bytes() == again


def test_shared_file_without_sound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    Piece().write(tmp_path / "mute.motion")
    assert app.run(["share", "mute.motion"]) == 0
    text = Path("mute.html").read_text(encoding="utf-8")
    assert "shared-sound" not in text.replace("shared-${name}", "")
    assert 'location.search || "")' in base64_of_module(text, "main.js")


def base64_of_module(text: str, name: str) -> str:
    (coded,) = re.findall(rf'"ergon/{re.escape(name)}": "data:text/javascript;base64,(.*?)"', text)
    return base64.b64decode(coded).decode()


def test_shared_title_is_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path, _ = shared("title", tmp_path, monkeypatch)
    text = path.read_text(encoding="utf-8")
    assert f"<title>{html.escape(TITLE)}</title>" in text
    assert "<img" not in text


def test_shared_file_size_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    motion = piece_with_sound(tmp_path)
    assert app.run(["share", str(motion), "--sound", "tones.wav", "--limit", "0.1"]) == 2
    message = capsys.readouterr().err
    assert re.search(r"--limit: piece\.html would have \d+\.\d MB \(\d\.\d MB of motion, ", message)
    assert not Path("piece.html").exists()
    assert app.run(["share", str(motion), "--until", "1s"]) == 2
    assert "--until needs a score" in capsys.readouterr().err


def test_share_of_a_long_piece_before_it_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    Path("long.yaml").write_text(SCORE.replace("tail: 1s", "tail: 3600s"))
    with monkeypatch.context() as patched:
        patched.setattr("ergon.api.viewing.write", lambda *_: pytest.fail("it was computed"))
        assert app.run(["share", "long.yaml"]) == 2
    message = capsys.readouterr().err
    assert re.search(
        r"would have about \d+\.\d MB .* not computed; share a shorter stretch", message
    )
    assert re.search(r"about \d+ s fit", message)
    assert app.run(["share", "long.yaml", "--until", "2s"]) == 0
    assert Path("long.html").exists()


@pytest.mark.parametrize("name", ["one-gesture", "rain"])
def test_check_estimate_within_a_factor_of_the_size(name: str, tmp_path: Path):
    """Twice the true size is not refused, an eighth of it is."""
    score = bundled_scores()[name]
    options = FileOptions(motion=True, until="3s")
    report = Report()
    prepared = prepare(read(score, options, report), str(tmp_path / "a.wav"), options, report)
    write(prepared, report)
    motion, sound = tmp_path / "a.motion", flac_file(tmp_path / "a.wav", tmp_path)
    size = (motion.stat().st_size + sound.stat().st_size) * 4 / 3e6
    check_estimate(prepared, tmp_path / "a.html", 2.0 * size)
    with pytest.raises(OptionError, match="would have about"):
        check_estimate(prepared, tmp_path / "a.html", size / 8.0)


def test_shared_page_with_changed_source_is_refused():
    """The words of the address are put in at the one place where the page reads them."""
    files = {"": "<!doctype html>", "main.js": "", "icon.svg": "", "style.css": ""}
    with pytest.raises(ValueError, match="words of its address"):
        shared_page(files.__getitem__, "t", [], b"", None)
