"""Scenes of another session of the same score: they bring what they are played on."""

from __future__ import annotations

import shutil
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from edited import opened
from sessions import Stepped

from tests.repl import test_repl_scenes
from tests.repl.test_repl_scenes import to_bar

SCORE = test_repl_scenes.SCORE.replace("8kHz", "16kHz")
MINE = """\
ergon: 1
instruments:
  plink:                                   # a small one
    modules: {m: {CEL: {M: 2g, f: 700Hz, t60: 300ms}}}
    play: {strike: {at: m, impulse: 1mNs..4mNs}}
    out: {SOX: m}
"""


def _folder(path: Path, name: str, score: str) -> Stepped:
    folder = path / name
    folder.mkdir()
    if name == "first":
        (folder / "kit").mkdir()
        (folder / "kit" / "mine.yaml").write_text(MINE)
    return Stepped(score, folder)


def _keep_verse(path: Path, lines: tuple[str, str]) -> tuple[Path, np.ndarray]:
    """The folder of a session in which bars 3 and 4 were kept as `verse`, and their sound."""
    with closing(_folder(path, "first", SCORE)) as first:
        first.ok("play")
        for line in lines[0].split("; "):
            first.ok(line)
        to_bar(first, 2)
        for line in lines[1].split("; "):
            first.ok(line)
        to_bar(first, 5)
        first.ok("keep 2bar as verse")
        bar = int(first.rate)
        return path / "first", first.sound[2 * bar : 4 * bar]


def _brought(path: Path, folder: Path) -> tuple[Stepped, np.ndarray]:
    """Another session of the score, after `scene verse`, and the sound of its first round."""
    second = _folder(path, "second", SCORE)
    for file in folder.iterdir():
        if file.name not in ("score.yaml", "session.jsonl"):
            copy = shutil.copytree if file.is_dir() else shutil.copy
            copy(file, path / "second" / file.name)
    second.ok("play")
    second.run(0.3)
    assert second.ok("scene verse").text == "ok 2|1 verse, from its beginning, again and again"
    to_bar(second, 6)
    bar = int(second.rate)
    return second, second.sound[bar : 3 * bar]


@pytest.mark.parametrize(
    "lines",
    [
        ("bell2 = bell transpose 7st", "d1 strikes bell2.m every 1/2 impulse 1mNs"),
        ("bell2 = bell transpose 7st", "ada plays knock every 1"),
        (
            "mia takes k3 like k1; deep = drum f=60Hz; link k3 deep.m BUT K=900N/m gap=1mm",
            "mia plays knock every 2",
        ),
        (
            "mia takes k3; link k3 bell.m BUT K=2kN/m gap=1mm",
            "mia plays knock every 1; ada plays knock every 2",
        ),
        (
            "bell2 = bell transpose 7st; room hall t60=200ms; route bell2 send hall -6dB",
            'd1 = "bell2.m*4" 1mNs',
        ),
        ("use kit/mine.yaml", "d1 strikes plink f every 1/2"),
        ("use kit/mine.yaml; use skins", 'd1 = "plink*2 ~ plink"'),
    ],
)
def test_scene_brings_instruments(tmp_path, lines):
    folder, verse = _keep_verse(tmp_path, lines)
    second, again = _brought(tmp_path, folder)
    with closing(second):
        scale = np.abs(verse).max()
        assert scale > 1e-6
        # Both begin at rest, so that the same matter sounds the same, but for rounding.
        assert np.abs(verse - again).max() < 1e-6 * scale
        second.ok("save later")
        assert opened(str(tmp_path / "second" / "later.yaml"))
        second.ok("undo")
        second.run(2.0)
        assert "bell2" not in second.session.schedule.head.piece.instruments
        second.ok("redo")
        second.run(1.5)
        second.close()
        assert np.array_equal(second.again(), second.sound)
        (tmp_path / "second" / "verse.yaml").unlink()
        with closing(Stepped.resumed(second.journal)) as resumed:
            resumed.ok("play")
            resumed.run(1.0)
            assert np.abs(resumed.sound).max() > 1e-7
            resumed.close()
            assert np.array_equal(resumed.again(), resumed.sound)


def test_scene_with_nothing_missing(tmp_path):
    folder, _ = _keep_verse(tmp_path, ("bell2 = bell transpose 7st", "leo plays lean every 2"))
    second, _ = _brought(tmp_path, folder)
    with closing(second):
        assert "bell2" not in second.session.schedule.head.piece.instruments


def test_scene_with_prefix_of_other_file_is_refused(tmp_path):
    folder, _ = _keep_verse(tmp_path, ("use kit/mine.yaml", "d1 strikes plink f every 1"))
    with closing(_folder(tmp_path, "second", SCORE)) as second:
        shutil.copytree(folder / "kit", tmp_path / "second" / "kit")
        shutil.copy(folder / "verse.yaml", tmp_path / "second")
        (tmp_path / "second" / "mine.yaml").write_text(MINE)
        second.ok("use mine.yaml")
        text = second.session.schedule.head.texts.text
        reply = second.type("scene verse")
        assert "uses kit/mine.yaml as mine, which is another file here" in reply.text
        assert second.session.schedule.head.texts.text == text


def test_scenes_in_succession_bring_instruments(tmp_path):
    folder, _ = _keep_verse(
        tmp_path, ("bell2 = bell transpose 7st", "d1 strikes bell2.m every 1 impulse 1mNs")
    )
    (tmp_path / "other").mkdir()
    other, _ = _keep_verse(
        tmp_path / "other", ("low = drum f=60Hz", "d1 strikes low.m every 1 impulse 1mNs")
    )
    shutil.copy(other / "verse.yaml", folder / "refrain.yaml")
    with closing(_folder(tmp_path, "second", SCORE)) as second:
        for name in ("verse.yaml", "refrain.yaml"):
            shutil.copy(folder / name, tmp_path / "second")
        second.ok("play")
        second.run(0.3)
        second.ok("scene verse -> refrain over 2bar")
        second.run(5.0)
        assert {"bell2", "low"} <= second.session.schedule.head.piece.instruments.keys()
        second.close()
        assert np.array_equal(second.again(), second.sound)
