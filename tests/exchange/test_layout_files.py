"""Layouts of other programs: there and back, and files from strangers."""

import json

import numpy as np
import pytest
from domes import dome

from ergon.exchange.layout_files import FORMS, LayoutFileError, as_yaml
from ergon.scores.reading.load import load
from ergon.space.directions import angles

SPEAKERS = [angles(place) for place in dome()]
FOUR = '<SPEAKER_SETUP SPEAKER_SETUP_VERSION="1"><SPEAKER_GROUP CARTESIAN_POSITION="0, 0, 0"%s>%s'
END = "</SPEAKER_GROUP></SPEAKER_SETUP>"


def fourth(*rows: str, group: str = "") -> bytes:
    """A SpatGRIS 4 setup."""
    return (FOUR % (group, "".join(rows)) + END).encode()


@pytest.mark.parametrize("name", FORMS)
def test_layout_round_trip_in_each_format(name: str):
    text = FORMS[name].write(SPEAKERS, range(1, len(SPEAKERS) + 1), 'A "dome" <&>\n: x')
    result = np.array(FORMS[name].read(text.encode()).speakers)
    wanted = np.array(SPEAKERS)
    if name == "spatgris":  # the farthest is 1 away
        wanted[:, 2] = 1.0
    away = (result[:, 0] - wanted[:, 0] + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(away, 0.0, atol=1e-6)
    np.testing.assert_allclose(result[:, 1:], wanted[:, 1:], atol=1e-6)


def test_iem_has_an_imaginary_loudspeaker_below():
    rows = json.loads(FORMS["iem"].write(SPEAKERS, range(1, len(SPEAKERS) + 1), "a"))[
        "LoudspeakerLayout"
    ]["Loudspeakers"]
    (below,) = [row for row in rows if row["IsImaginary"]]
    assert (below["Elevation"], below["Gain"], len(rows)) == (-90.0, 0.0, 25)
    assert [row["Channel"] for row in rows[:24]] == [*range(1, 25)]


def test_layout_channel_numbers_give_order():
    rows = [
        {"Azimuth": 10.0 * i, "Elevation": 0, "Radius": 2, "IsImaginary": i == 3, "Channel": 9 - i}
        for i in range(5)
    ]
    text = json.dumps({"LoudspeakerLayout": {"Loudspeakers": rows}})
    layout = FORMS["iem"].read(text.encode())
    assert [azimuth for azimuth, *_ in layout.speakers] == [40.0, 20.0, 10.0, 0.0]


def test_spatgris_layouts_of_both_versions():
    old = b"""<?xml version="1.0"?><SPEAKER_SETUP VERSION="3.1.14" SPAT_MODE="Dome">
      <SPEAKER_2 STATE="normal" GAIN="0"><POSITION X="-1" Y="0" Z="0"/></SPEAKER_2>
      <SPEAKER_1 STATE="normal"><POSITION X="0" Y="1" Z="0"/><HIGHPASS FREQ="60"/></SPEAKER_1>
      <SPEAKER_3 DIRECT_OUT_ONLY="1"><POSITION X="0" Y="1" Z="0"/></SPEAKER_3></SPEAKER_SETUP>"""
    new = fourth(
        '<SPEAKER SPEAKER_PATCH_ID="2" CARTESIAN_POSITION="-1, 0, 0"/>',
        '<SPEAKER SPEAKER_PATCH_ID="1" CARTESIAN_POSITION="0.0, 1.0, 0.0"/>',
    )
    for text in (old, new):
        assert FORMS["spatgris"].read(text).speakers == [(0.0, 0.0, 1.0), (90.0, 0.0, 1.0)]


def test_spatgris_version_4_positions():
    rows = [
        f'<SPEAKER SPEAKER_PATCH_ID="{i}" CARTESIAN_POSITION="{place}"/>'
        for i, place in enumerate(("(0, 1, 0)", "( -1,0 ,0 )", "(0.0, 0.0, 1.0)"), 1)
    ]
    text = fourth(*rows).replace(b'"0, 0, 0"', b'"(0, 0, 0)"')
    layout = FORMS["spatgris"].read(text)
    np.testing.assert_allclose(
        layout.speakers, [(0.0, 0.0, 1.0), (90.0, 0.0, 1.0), (0.0, 90.0, 1.0)], atol=1e-12
    )
    assert layout.notes() == []
    with pytest.raises(LayoutFileError, match="moved or turned"):
        FORMS["spatgris"].read(text.replace(b'"(0, 0, 0)"', b'"(0, 1, 0)"'))


def test_spatgris_direct_out_and_gap_notes():
    row = '<SPEAKER SPEAKER_PATCH_ID="%d" DIRECT_OUT_ONLY="%d" CARTESIAN_POSITION="%d, 1, 0"/>'
    text = fourth(*(row % (i, i == 3, i) for i in (1, 2, 3, 4, 6)))
    layout = FORMS["spatgris"].read(text)
    assert layout.outputs == [1, 2, 4, 6]
    direct, gap = layout.notes()
    assert direct == "output 3 is a direct out, no loudspeaker of the room: it is left out"
    assert gap == "its loudspeakers keep their outputs: 1, 2, 4, 6"


@pytest.mark.parametrize("names", ["LFE1", "LFE2", "[LFE1, sub]", "LFE", "Subwoofer"])
def test_layout_low_frequency_channels_are_left_out(names: str):
    text = "speakers:\n"
    for channel, name, az in (
        (0, "M+030", 30),
        (1, "M-030", -30),
        (3, names, 45),
        (4, "B+045", 45),
    ):
        text += f"- {{channel: {channel}, names: {name}, position: {{az: {az}, el: 0, r: 2}}}}\n"
    layout = FORMS["ear"].read(text.encode())
    assert layout.speakers == [(30.0, 0.0, 2.0), (-30.0, 0.0, 2.0), (45.0, 0.0, 2.0)]
    assert layout.outputs == [1, 2, 5]
    effects, gap = layout.notes()
    assert effects.startswith("output 4 (")
    assert "low-frequency effects" in effects
    assert gap.endswith("outputs: 1, 2, 5")


def test_converted_layout_used_by_score(tmp_path):
    (tmp_path / "room.yaml").write_text(as_yaml(SPEAKERS, 'x"\n: [', 6.0))
    text = "ergon: 1\ninstruments: {b: {BANK: {count: 9, f: 1kHz, t60: 1s, M: 1g}, "
    text += "out: {SOX: b.all}}}\n"
    text += "mix: {layout: room.yaml, route: {from: b, to: nearest}}\n"
    loaded = load(tmp_path / "a.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    assert loaded.piece.mix.layout is not None
    np.testing.assert_allclose(loaded.piece.mix.layout.speakers, 2.0 * np.array(dome()), atol=1e-6)


SPEAKER = '{"Azimuth": %s, "Elevation": 0, "Radius": %s, "Channel": %s}'


def iem(*rows: str) -> bytes:
    return ('{"LoudspeakerLayout": {"Loudspeakers": [' + ",".join(rows) + "]}}").encode()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("iem", b"{", "not JSON"),
        ("iem", b"[" * 100_000, "not JSON"),
        ("iem", b"\xff\xfe", "not JSON"),
        ("iem", b"[]", "no list"),
        ("iem", iem("7"), "no list"),
        ("iem", iem(), "0 loudspeakers"),
        ("iem", iem(SPEAKER % ("NaN", 1, 1)), "not a valid azimuth"),
        ("iem", iem(SPEAKER % ("true", 1, 1)), "not a valid azimuth"),
        ("iem", iem(SPEAKER % (400, 1, 1)), "lies at 400"),
        ("iem", iem(SPEAKER % (0, 0, 1)), "0 m away"),
        (
            "iem",
            iem(SPEAKER % (0, 1, 1), SPEAKER % (9, 1, 1)),
            "2 of its loudspeakers have the channel 1; give",
        ),
        ("iem", iem(*(SPEAKER % (0, 1, i) for i in range(1025))), "1,025 loudspeakers"),
        ("ear", b"a: &b [*b, *b]", "aliases"),
        ("ear", b"!!python/object/apply:os.system [ls]", "no list"),
        ("ear", b"[" * 5000 + b"]" * 5000, "nested|not YAML"),
        ("ear", b"speakers: 3", "no list"),
        ("ear", b"speakers: [{channel: 0, names: a}]", "no position"),
        ("ear", b"- {channel: 0, position: {az: x}}", "not a valid azimuth"),
        ("spatgris", b"<a/>", "not SPEAKER_SETUP"),
        ("spatgris", b"<!DOCTYPE a><SPEAKER_SETUP/>", "document type"),
        ("spatgris", b"<SPEAKER_SETUP><SPEAKER_1/></SPEAKER_SETUP>", "no position"),
        ("spatgris", fourth('<SPEAKER SPEAKER_PATCH_ID="1"/>'), "no position"),
        ("spatgris", fourth(group=' YAW="30"'), "moved or turned"),
        ("spatgris", fourth('<SPEAKER CARTESIAN_POSITION="0,1,0"/>'), "number of an output"),
    ],
)
def test_malformed_layout_files_are_refused(name: str, text: bytes, words: str):
    with pytest.raises(LayoutFileError, match=words):
        FORMS[name].read(text)
