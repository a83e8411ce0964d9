"""What a used file says of its own time is left out, and the score is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from ergon.scores.reading.load import load

USED = """\
ergon: 1
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
gestures: {knock: 0mm@0 smooth 3mm@1/8}
"""
PLAYED = {
    "parts": "players: {leo: {key: k1}}\nparts: {leo: [{at: 1|1, play: knock}]}\n",
    "strikes": "strikes: {s: {to: k1, at: 1|1, impulse: 1mNs}}\n",
    "duet": "duet: [{couple: [k1, k1], REF: {K: 1N/m, Z: 0.1Ns/m}, at: 1|1}]\n",
    "automation": "automation: [{set: k1.K, to: x2, over: 1, at: 1|1}]\n",
}
SCORE = """\
ergon: 1
use: [other.yaml]
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: knock}]}
"""


@pytest.mark.parametrize("section", PLAYED)
def test_ignored_section_of_used_file_warns_once(tmp_path: Path, section: str):
    (tmp_path / "other.yaml").write_text(USED + PLAYED[section], encoding="utf-8")
    path = tmp_path / "score.yaml"
    path.write_text(SCORE, encoding="utf-8")
    result = [item for item in load(path).diagnostics if item.code == "W330"]
    (item,) = result
    assert f"`{section}`" in item.message
    assert (item.place.file, item.place.line) == (str(path), 2)


def test_used_file_of_definitions_has_no_warning(tmp_path: Path):
    (tmp_path / "other.yaml").write_text(USED, encoding="utf-8")
    path = tmp_path / "score.yaml"
    path.write_text(SCORE, encoding="utf-8")
    assert not [one for one in load(path).diagnostics if one.code == "W330"]


@pytest.mark.parametrize("text", ["", "# all is to come\n"])
@pytest.mark.parametrize(
    "score",
    ["ergon: 1\nkeys: {k1: {calib: other.yaml}}\n", "ergon: 1\nmix: {layout: other.yaml}\n"],
    ids=["calib", "layout"],
)
def test_empty_used_file_is_refused(tmp_path: Path, text: str, score: str):
    (tmp_path / "other.yaml").write_text(text, encoding="utf-8")
    path = tmp_path / "score.yaml"
    path.write_text(score, encoding="utf-8")
    result = load(path)
    assert result.has_errors
    (empty,) = [one for one in result.diagnostics if one.code == "E103" and "empty" in one.message]
    assert empty.message == "other.yaml is empty"
    assert empty.place.file == str(path)


def test_missing_name_of_empty_used_file(tmp_path: Path):
    """A link to one of them went on to the engine, which was an internal error."""
    (tmp_path / "other.yaml").write_text("# keys are to come\n", encoding="utf-8")
    path = tmp_path / "score.yaml"
    modules = "{m: {CEL: {M: 2g, f: A3}}, b: {BUT: {between: [k1, m], K: 1kN/m}}}"
    head = "ergon: 1\nuse: [other.yaml]\n"
    path.write_text(f"{head}instruments: {{i: {{modules: {modules}}}}}\n", encoding="utf-8")
    (missed,) = [one for one in load(path).diagnostics if one.severity == "error"]
    assert missed.code == "E301"
    assert "'k1'" in missed.message
