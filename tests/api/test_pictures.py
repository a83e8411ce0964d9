"""What a notebook shows of results: pictures, tables, sound that can be played."""

from __future__ import annotations

import base64
import re
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import soundfile
from one_bell import SCORE

import ergon


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("bell.yaml").write_text(SCORE)
    return tmp_path


def sound_in(html: str) -> tuple[np.ndarray, int]:
    match = re.search(r"src='data:audio/flac;base64,([^']*)'", html)
    assert match is not None
    return soundfile.read(BytesIO(base64.b64decode(match[1])), always_2d=True)


def test_render_html_with_sound_and_plot():
    sound = ergon.render("bell.yaml", ergon.RenderOptions(until="0.5s"))
    html = sound._repr_html_()
    frames, rate = sound_in(html)
    assert rate == sound.rate
    assert frames.shape == sound.frames.shape
    assert np.max(np.abs(frames - sound.frames)) <= 2**-15
    ElementTree.fromstring(sound.plot("A <bell>").svg)
    assert "A &lt;bell&gt;" in sound.plot("A <bell>").svg
    assert sound.plot().svg in html


def test_render_html_of_four_channels_folded_to_stereo():
    frames = np.zeros((1000, 4))
    frames[:, 0], frames[:, 2], frames[:, 1] = 1.5, 4.5, 0.3
    html = ergon.Render(frames, 8000.0, 4.5, 0.0, 1.0, 4.5)._repr_html_()
    sound, _ = sound_in(html)
    np.testing.assert_allclose(sound[500], [1.0, 0.15 / 3.0], atol=2**-14)


def test_modes_html_with_nearest_notes():
    _, bell = ergon.modes("bell.yaml")
    assert [note for note, _ in bell.notes] == ["A3"]
    f = float(bell.frequencies[0])
    assert bell.notes[0][1] == pytest.approx(1200 * np.log2(f / 220.0), abs=1e-6)
    table = ElementTree.fromstring(bell._repr_html_())
    assert [cell.text for cell in table.iter("td")][:4] == ["1", "A3", "+0.0", f"{f:.2f} Hz"]
    ElementTree.fromstring(bell.plot().svg)


def test_plan_and_reply_html():
    plan = ergon.plan("bell.yaml")
    table = ElementTree.fromstring(plan._repr_html_())
    assert len(list(table.iter("tr"))) == 1 + len(plan.rows)
    reply = ergon.Reply(False, "no knock", "ada plays knock", ("a < b",))
    assert str(reply) == "no knock\ntry: ada plays knock\na < b"
    assert "a &lt; b" in reply._repr_html_()


def test_picture_write_read_and_refusal():
    answer = ergon.admittance("bell.yaml", "bell.m")
    picture = answer.plot()
    assert answer._repr_svg_() == picture._repr_svg_()
    picture.write("bell.svg")
    assert ergon.Picture.read("bell.svg") == picture
    Path("mine.svg").write_text("<svg/>")
    with pytest.raises(ergon.FileRefusedError):
        picture.write("mine.svg")
    picture.write("mine.svg", force=True)
    assert ergon.Picture.read("mine.svg") == picture
