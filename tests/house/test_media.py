"""Sounds and pictures of README.md: small, and what the scores render."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import soundfile
from sweep import few

from docs.generators.film import LARGEST as FILM_LARGEST
from docs.generators.prompt_picture import LINES
from docs.generators.sounds import LARGEST, SECONDS, SOUNDS, rendered

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", few(SOUNDS, ["first", "change-ringing"]))
def test_readme_sound_equals_render_of_its_score(name: str):
    path = ROOT / "docs" / "sounds" / f"{name}.ogg"
    assert f"(docs/sounds/{name}.ogg)" in README
    assert path.stat().st_size <= LARGEST
    sound, rate = soundfile.read(path, always_2d=True)
    frames, score_rate = rendered(name)
    assert (rate, sound.shape) == (score_rate, frames.shape)
    assert len(frames) == SECONDS * rate
    difference = np.sum((sound - frames) ** 2) / np.sum(frames**2)
    assert 10 * np.log10(difference) < -20.0  # what Vorbis changes


def test_readme_film_size_and_motion():
    content = (ROOT / "docs" / "pictures" / "galaxy.webp").read_bytes()
    assert len(content) <= FILM_LARGEST
    assert (content[:4], content[8:12]) == (b"RIFF", b"WEBP")
    frames = re.findall(rb"ANMF.{16}(.{3})", content, re.DOTALL)
    assert len(frames) >= 45
    seconds = sum(int.from_bytes(frame, "little") for frame in frames) / 1000
    assert 3.0 <= seconds <= 4.0


def test_prompt_picture_shows_its_lines():
    tree = ElementTree.parse(ROOT / "docs" / "pictures" / "prompt.svg")
    texts = [element.text or "" for element in tree.iter("{http://www.w3.org/2000/svg}text")]
    for line in LINES:
        assert any(text.endswith(line) for text in texts), line
    assert any("try: ada plays knock every 1/2" in text for text in texts)
