"""Odd files of loudspeakers: what writers break is read rightly, named, or refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from commands import forked

from ergon.exchange.layout_files import FORMS, LayoutFileError

_IEM = {"Azimuth": 30, "Elevation": 0, "Radius": 2, "IsImaginary": False, "Channel": 1, "Gain": 1}
_PLACE = "position: {az: 30, el: 0, r: 2}"


def iem(**fields: object) -> bytes:
    return json.dumps({"LoudspeakerLayout": {"Loudspeakers": [{**_IEM, **fields}]}}).encode()


def ear(fields: str = "channel: 0", place: str = _PLACE) -> bytes:
    return f"speakers:\n- {{{fields}, names: M+030, {place}}}\n".encode()


def third(x: object = 1, y: object = 0, z: object = 0, number: str = "1", more: str = "") -> bytes:
    place = f'<POSITION X="{x}" Y="{y}" Z="{z}"/>'
    row = f'<SPEAKER_{number} STATE="normal" {more}>{place}</SPEAKER_{number}>'
    return f'<SPEAKER_SETUP VERSION="3.1.0">{row}</SPEAKER_SETUP>'.encode()


def fourth(fields: str) -> bytes:
    row = f'<SPEAKER CARTESIAN_POSITION="(1, 0, 0)" {fields}/>'
    return f"<SPEAKER_SETUP><SPEAKER_GROUP>{row}</SPEAKER_GROUP></SPEAKER_SETUP>".encode()


SPATGRIS_2 = (
    b'<?xml version="1.0"?>\n<SpeakerSetup Name="x" Dimension="3"><Ring>'
    b'<Speaker LayoutIndex="1" PositionX="-0.5" PositionY="0.9" OutputPatch="1"/></Ring>'
    b"</SpeakerSetup>"
)

REFUSED = {
    "spatgris 2": ("spatgris", SPATGRIS_2, "SpatGRIS 2; open it in SpatGRIS 3 or later and save"),
    "ear places": (
        "ear", ear(place="position: {X: -1, Y: 1, Z: 0}"), "1 has no azimuth: .* X, Y, Z"
    ),
    "iem without an angle": (
        "iem", b'{"LoudspeakerLayout": {"Loudspeakers": [{"Azimuth": 1}]}}', "1 has no Elevation"
    ),
    "iem output 0": ("iem", iem(Channel=0), "counted from 1"),
    "iem output -1": ("iem", iem(Channel=-1), "counted from 1"),
    "iem output of millions": ("iem", iem(Channel=10**8), "counted from 1 to 65,536"),
    "iem digits with a line": ("iem", iem(Azimuth="3_0"), "not a valid azimuth"),
    "ear output -1": ("ear", ear("channel: -1"), "counted from 0"),
    "ear output of millions": ("ear", ear("channel: 99999999"), "counted from 0"),
    "ear numbers to the base of 60": ("ear", ear("channel: 1" + ":1" * 9999), "not a valid"),
    "ear base of 60 and a point": ("ear", ear("channel: 1" + ":1" * 400 + ".5"), "not a valid"),
    "ear date": ("ear", ear("channel: 2001-01-01"), "not a valid channel"),
    "ear switch": ("ear", ear("channel: yes"), "not a valid channel"),
    "ear infinity": ("ear", ear(place="position: {az: 1, el: .inf, r: 1}"), "not a valid"),
    "ear key twice": ("ear", ear("channel: 0, channel: 1"), "'channel' twice"),
    "ear list as a key": ("ear", b"speakers:\n- {? [1] : 3}\n", "not YAML"),
    "ear thousands of rows": ("ear", b"- {channel: 0}\n" * 20_000, "more than 65,536 values"),
    "spatgris origin": ("spatgris", third(0, 0, 0), "0 m away"),
    "spatgris far": ("spatgris", third(1e8), "1e[+]08 m away"),
    "spatgris output 0": ("spatgris", third(number="0"), "counted from 1"),
    "spatgris output -1": ("spatgris", fourth('SPEAKER_PATCH_ID="-1"'), "counted from 1"),
    "spatgris no output": ("spatgris", fourth(""), "not a valid number of an output"),
    "spatgris decimal comma": ("spatgris", third("0,5"), "not a valid position"),
    "spatgris infinity": ("spatgris", third("inf"), "not a valid position"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_odd_layouts_are_refused(name: str) -> None:
    form, data, words = REFUSED[name]
    with pytest.raises(LayoutFileError, match=words):
        FORMS[form].read(data)


READ = {
    "iem switch as a text": ("iem", iem(IsImaginary="false"), 30.0, []),
    "iem switch as a number": ("iem", iem(IsImaginary=0), 30.0, []),
    "iem other field": ("iem", iem(Mute=True), 30.0, ["the Mute of output 1 is not kept"]),
    "iem mark": ("iem", b"\xef\xbb\xbf" + iem(), 30.0, []),
    "ear zero in front": ("ear", ear(place="position: {az: 030, el: 0, r: 1}"), 30.0, []),
    "ear texts": ("ear", ear(place='position: {az: "30", el: "0", r: "1"}'), 30.0, []),
    "ear UTF-16": ("ear", ear().decode().encode("utf-16"), 30.0, []),
    "ear other fields": (
        "ear", ear("channel: 0, delay: 3", "position: {az: 30, el: 0, r: 1, x: 4}"), 30.0,
        ["the delay of output 1 is not kept", "the x of output 1 is not kept"],
    ),
    "spatgris UTF-16": ("spatgris", third().decode().encode("utf-16"), -90.0, []),
    "spatgris says UTF-16": (
        "spatgris", b"<?xml version='1.0' encoding='utf-16'?>" + third(), -90.0, [],
    ),
    "spatgris other fields": (
        "spatgris", fourth('SPEAKER_PATCH_ID="1" UUID="7" DELAY="3"'), -90.0,
        ["the DELAY of output 1 is not kept"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_odd_layouts_with_right_places(name: str) -> None:
    form, data, azimuth, left_out = READ[name]
    layout = FORMS[form].read(data)
    assert layout.outputs == [1]
    assert layout.speakers[0][:2] == pytest.approx((azimuth, 0.0))
    assert layout.left_out == left_out


def test_imaginary_and_direct_loudspeakers_are_named() -> None:
    rows = [_IEM, {**_IEM, "IsImaginary": "True", "Channel": -1}]
    data = json.dumps({"LoudspeakerLayout": {"Loudspeakers": rows}}).encode()
    assert FORMS["iem"].read(data).left_out == ["1 imaginary loudspeaker is left out"]
    with pytest.raises(LayoutFileError, match="it has 0 loudspeakers"):
        FORMS["spatgris"].read(third(more='DIRECT_OUT_ONLY="true"'))


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.yaml", b"- names: M+030\n  channel: 0\n  position: {az: 30}\n"),
        ("a.yaml", b"# made by hand\n---\n- {names: M+030, position: {az: 30}, channel: 0}\n"),
        ("a.yaml", b"{speakers: [{channel: 0, position: {az: 30}}]}\n"),
        ("a.yaml", json.dumps({"speakers": [{"channel": 0, "position": {"az": 30}}]}).encode()),
        ("a.yaml", ear().decode().encode("utf-16")),
        ("a.xml", third().decode().encode("utf-16")),
    ],
)
def test_info_knows_layouts_in_any_order(name: str, data: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(data)
    done = forked(["info", name, "--json"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["loudspeakers"] == 1


@pytest.mark.parametrize("value", ["true", "yes", "1"])
def test_ear_loudspeaker_for_effects_is_left_out(value: str) -> None:
    rows = b"- {channel: 0, names: L, position: {az: 30}}\n"
    rows += f"- {{channel: 1, names: Low, is_lfe: {value}, position: {{az: 0}}}}\n".encode()
    layout = FORMS["ear"].read(rows)
    assert layout.outputs == [1]
    assert layout.left_out[0].startswith("output 2 (Low) is for low-frequency effects")
    full_range = FORMS["ear"].read(rows.replace(f"is_lfe: {value}".encode(), b"is_lfe: false"))
    assert (full_range.outputs, full_range.left_out) == ([1, 2], [])


def test_info_refuses_setup_of_spatgris_2(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_bytes(SPATGRIS_2)
    done = forked(["info", "a.xml"], tmp_path)
    assert done.returncode == 2
    assert "save it from there" in done.stderr


def test_info_says_why_a_layout_is_refused(tmp_path: Path) -> None:
    """Before, it said that the file is nothing that ergon reads."""
    (tmp_path / "a.xml").write_bytes(third("nan"))
    done = forked(["info", "a.xml"], tmp_path)
    assert done.returncode == 2
    assert "'nan' is not a valid position" in done.stderr


def test_info_names_mistakes_of_a_layout_of_ergon(tmp_path: Path) -> None:
    """Before, it ended without a word."""
    (tmp_path / "a.yaml").write_text("ergon: 1\nspeakers: [{az: 30}, {azz: -30}]\n")
    done = forked(["info", "a.yaml"], tmp_path)
    assert done.returncode == 2
    assert "a.yaml:2" in done.stderr
    assert "azz" in done.stderr
