"""Models of miPhysics as scores, beside an interpreter of its equations."""

import random
import re
from pathlib import Path

import pytest
from models_compared import miphysics_off

from ergon.cli import app
from ergon.scores.reading.load import load
from ergon.workshop.api.model import ModelOptions, import_model
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.miphysics.reading import LINKS, MASSES, is_model, parse
from ergon.workshop.models.miphysics.score import score_text

RATE = 44_100
FRAMES = 2_000


def place(x: float, y: float, z: float) -> str:
    return f'initPos.x="{x}" initPos.y="{y}" initPos.z="{z}"'


def speed(x: float, y: float, z: float) -> str:
    return f'initVel.x="{x}" initVel.y="{y}" initVel.z="{z}"'


def ground(name: str, *at: float, kind: str = "Ground3D") -> tuple[str, str]:
    return kind, f'name="{name}" {place(*at)}'


def mass(
    name: str,
    m: float,
    position: tuple[float, float, float],
    v: tuple[float, float, float] = (0, 0, 0),
) -> tuple[str, str]:
    return "Mass3D", f'name="{name}" mass="{m}" {place(*position)} {speed(*v)}'


def line(name: str, m: float, z: float, v: float, kind: str = "Mass1D", more: str = "") -> tuple:
    return kind, f'name="{name}" mass="{m}" {place(0, 0, z)} {speed(0, 0, v)} {more}'


def link(kind: str, a: str, b: str, k: float, z: float, rest: float, more: str = "") -> tuple:
    values = f'stiffness="{k}" damping="{z}" drest="{rest}"'
    return kind, f'name="l" m1="{a}" m2="{b}" {values} {more}'


def model(*parts: tuple, gravity: float = 0.0, friction: float = 0.0, up: str = "0 0 1") -> str:
    x, y, z = up.split()
    rows = ['<?xml version="1.0" encoding="UTF-8"?>', "<Model.xml>", "  <global>"]
    rows += [f'    <gravity gravity="{gravity}"/>', f'    <friction friction="{friction}"/>']
    rows += [f'    <vector pos.x="{x}" pos.y="{y}" pos.z="{z}"/>', "  </global>"]
    for section, kinds, item in (("MAT", MASSES, "mass"), ("Link", LINKS, "interaction")):
        rows.append(f"  <{section}>")
        for kind in kinds:
            rows.append(f"    <{kind}>")
            entry = [row for word, row in parts if word == kind]
            rows += [f"      <{item}_{at} {row}/>" for at, row in enumerate(entry)]
            rows.append(f"    </{kind}>")
        rows.append(f"  </{section}>")
    return "\n".join([*rows, "</Model.xml>"])


TIED = (ground("g", 0, 0, 0), mass("m", 2.0, (0, 0, 70)))
IN_LINE = {
    "a spring": model(*TIED, link("Spring3D", "g", "m", 0.01, 0.0, 60)),
    "a damped spring": model(*TIED, link("SpringDamper3D", "g", "m", 0.01, 0.005, 60)),
    "a damper": model(
        ground("g", 0, 0, 0), mass("m", 2.0, (0, 0, 70), (0, 0, 9e3)),
        link("Damper3D", "m", "g", 0.0, 0.01, 0)),
    "free fall with friction": model(mass("m", 2.0, (1, 2, 3), (8e2, -4e3, 3e3)), gravity=1e-3,
                                     friction=2e-3),
    "friction and a spring": model(*TIED, link("SpringDamper3D", "g", "m", 0.01, 0.005, 60),
                                   gravity=1e-3, friction=2e-3),
    "a rope": model(*TIED, link("Rope3D", "g", "m", 0.02, 0.01, 65), gravity=-0.0),
    "a bubble": model(*TIED, link("Bubble3D", "m", "g", 0.02, 0.01, 65)),
    "a contact": model(mass("m", 2.0, (0, 0, 30), (0, 0, -4e3)), mass("p", 1.0, (0, 0, 0)),
                       link("Contact3D", "m", "p", 0.02, 0.01, 20)),
    "a plane": model(
        mass("m", 2.0, (0, 0, 30)), gravity=1e-3) .replace("<PlaneContact3D>", '<PlaneContact3D>\n'
        '<interaction_0 name="f" m1="m" m2="" stiffness="0.1" damping="0.005" drest="5.0" '
        'orientation="2" position="-10.0"/>'),
    "planes across": model(
        mass("m", 1.0, (3, 0, 3), (-4e3, 3e3, 0)), mass("p", 2.0, (8, 0, 3), (-4e3, 0, 0)),
        *(("PlaneContact3D", f'name="f" m1="{m}" m2="" stiffness="0.1" damping="0.0" drest="1.5" '
           f'orientation="{at}" position="-10.0"') for m in "mp" for at in range(2))),
}  # fmt: skip
ACROSS = {
    "a pendulum": model(
        ground("g", 0, 0, 0), mass("m", 20.0, (60, 0, 0), (0, 3e3, 0)),
        mass("p", 5.0, (90, 10, 0)), link("SpringDamper3D", "g", "m", 0.02, 0.01, 60),
        link("Rope3D", "m", "p", 0.02, 0.03, 25), gravity=1e-4, friction=1e-4),
    "a tetrahedron": model(
        *(mass(f"m{i}", 1.0 + i, at, (2e3 * i, 0, 0)) for i, at in
          enumerate([(0.0, 0.0, 0.0), (25.0, 0.0, 0.0), (0.0, 25.0, 0.0), (0.0, 0.0, 25.0)])),
        *(link("SpringDamper3D", f"m{i}", f"m{j}", 0.05, 0.02, 24.0)
          for i in range(4) for j in range(i))),
    "spheres that glance off": model(
        mass("m", 2.0, (0, 4, 30), (0, 0, -6e3)), mass("p", 1.0, (0, 0, 0)),
        link("Contact3D", "m", "p", 0.02, 0.05, 20)),
}  # fmt: skip
AXIS = {
    "a string of one axis": model(
        ground("g", 0, 0, 0, kind="Ground1D"), ground("h", 0, 0, 0.001, kind="Ground1D"),
        *(line(f"m{i}", 2.0, 0.0, 300.0 * (i == 2)) for i in range(6)),
        *(link("SpringDamper1D", f"m{i}", f"m{i + 1}", 0.1, 0.003, 0.0) for i in range(5)),
        link("SpringDamper1D", "g", "m0", 0.1, 0.003, 0.0),
        link("SpringDamper1D", "m5", "h", 0.1, 0.003, 0.002)),
    "friction, gravity, grounds": model(
        ground("g", 0, 0, 0.5, kind="Ground1D"), ground("h", 0, 0, 0, kind="Ground1D"),
        line("m", 3.0, 0.2, 20.0), line("p", 1.0, 0.1, 0.0),
        link("SpringDamper1D", "m", "g", 0.02, 0.001, 0.1),
        link("SpringDamper1D", "g", "h", 0.02, 0.001, 0.1),
        link("SpringDamper1D", "p", "m", 0.03, 0.0, -0.1), gravity=1e-5, friction=1e-3),
    "cells": model(
        line("o", 2.0, 0.5, 300.0, "Osc1D", 'stiffness="0.01" damping="0.002"'),
        line("q", 2.0, 0.0, 0.0, "Osc1D", 'stiffness="0.03" damping="0.0"'),
        link("SpringDamper1D", "o", "q", 0.01, 0.001, 0.3), friction=1e-4),
}  # fmt: skip


@pytest.mark.parametrize("name", IN_LINE)
def test_miphysics_links_in_line_equal_interpreter(name: str) -> None:
    assert miphysics_off(IN_LINE[name], FRAMES) < 1e-9


@pytest.mark.parametrize("name", ACROSS)
def test_miphysics_turning_links_equal_interpreter(name: str) -> None:
    # The same equations, but for dampers, which feel the step along the line.
    assert miphysics_off(ACROSS[name], FRAMES, along=True) < 1e-9
    assert 1e-9 < miphysics_off(ACROSS[name], FRAMES) < 0.02


@pytest.mark.parametrize("name", AXIS)
def test_miphysics_model_of_one_axis(name: str) -> None:
    assert miphysics_off(AXIS[name], FRAMES) < 1e-12


@pytest.mark.parametrize("name", ["friction and a spring", "cells"])
def test_miphysics_model_at_another_rate(name: str) -> None:
    assert miphysics_off({**IN_LINE, **AXIS}[name], FRAMES, 8_000) < 1e-9


def test_miphysics_all_module_kinds_tested() -> None:
    text = "\n".join([*IN_LINE.values(), *ACROSS.values(), *AXIS.values()])
    for kind in (*MASSES, *LINKS):
        assert re.search(rf"<{kind}>\s*<(mass|interaction)_0", text), kind


# --- the file -----------------------------------------------------------------------------------

BOTH = model(*TIED, link("Rope3D", "g", "m", 0.02, 0.01, 65), line("o", 2.0, 0.5, 1.0),
             ground("w", 0, 0, 0, kind="Ground1D"), link("SpringDamper1D", "o", "w", 0.1, 0.0, 0.4),
             gravity=1e-3)  # fmt: skip


@pytest.mark.usefixtures("work_folder")
def test_miphysics_import_to_score_and_rate_value(capsys: pytest.CaptureFixture[str]) -> None:
    Path("m.xml").write_text(BOTH)
    assert app.run(["import", "m.xml", "-o", "s.yaml"]) == 0
    assert "6 statements of miphysics" in "".join(capsys.readouterr())
    score = Path("s.yaml").read_text()
    for message in (
        "    space: 3  # a unit of the model is a millimetre",
        "    gravity: 1944.81m/s2  # 0.001 a sample²",
        "      l: {BUT: {between: [g, m], K: 0.02*stiff, Z: 0.01*viscous, gap: 65mm, "
        "side: inside}}",
        "      l_2: {REF: {between: [w, o], K: 0.1, Z: 0, rest: 0.4m}}",
        "    out: {heard: {SOX: m.z}}",
        "  channels: 2",
    ):
        assert f"\n{message}\n" in score, message
    assert app.run(["render", "s.yaml", "-o", "s.wav", "--force"]) == 0
    built = import_model("m.xml", ModelOptions(dialect="miphysics", values={"rate": "1050"}))
    assert "rates: {audio: 1050Hz}" in built.text
    assert load("s.yaml", text=built.text).piece is not None


REFUSED = {
    "no XML": ("<MAT>", "the XML is not well formed"),
    "a document type": ("<!DOCTYPE a [<!ENTITY b 'c'>]><a><MAT>&b;</MAT></a>", "a document type"),
    "too deep": (BOTH.replace("<Spring3D>", "<Spring3D><x name='x' m1='g' m2='m' stiffness='1' "
                 "drest='1'>" + "<y>" * 9), "deeper than 8"),
    "no masses": (model(), "it has no masses"),
    "an unknown section": (BOTH.replace("<Link>", "<Lnik>").replace("</Link>", "</Lnik>"),
                           "'Lnik' is not part of a model.*'Link'"),
    "an unknown global": (BOTH.replace("<friction", "<fricton"), "'fricton'.*'friction'"),
    "an unknown mass": (BOTH.replace("Mass3D", "Mass3d"), "'Mass3d' is not a kind.*'Mass3D'"),
    "an unknown link": (BOTH.replace("Rope3D", "Rope"), "'Rope' is not a kind of links"),
    "a kind that is not built": (BOTH.replace("Mass3D", "Osc3D"), "Osc3D: a point in space"),
    "no name": (BOTH.replace('name="m"', 'name=""'), "has no name"),
    "a name twice": (BOTH.replace('name="w"', 'name="m"'), "'m' is the name of line"),
    "no such mass": (BOTH.replace('m2="m"', 'm2="mm"'), "no mass is called 'mm'"),
    "itself": (BOTH.replace('m1="g"', 'm1="m"'), "joins 'm' to itself"),
    "one axis and three": (BOTH.replace('m2="m"', 'm2="o"'), "'o' has one axis"),
    "a missing number": (BOTH.replace('drest="65"', ""), "drest is missing"),
    "no number": (BOTH.replace('drest="65"', 'drest="6_5"'), "'6_5', which is not a number"),
    "no finite number": (BOTH.replace('drest="65"', 'drest="1e999"'), "which is not a number"),
    "energy": (BOTH.replace('damping="0.01"', 'damping="-1"'), "damping is -1"),
    "a distance below 0": (BOTH.replace('drest="65"', 'drest="-6"'), "drest is -6"),
    "no weight": (BOTH.replace('mass="2.0"', 'mass="0.0"'), "mass is 0"),
    "gravity aside": (BOTH.replace('pos.x="0"', 'pos.x="1"'), "along another axis than z"),
    "too much gravity": (BOTH.replace('gravity="0.001"', 'gravity="0.1"'), "set a lower rate"),
    "far away": (BOTH.replace('initPos.z="70"', 'initPos.z="7e6"'), "a place is 7e\\+06"),
    "another orientation": (
        model(*TIED, ("PlaneContact3D", 'name="f" m1="m" m2="" stiffness="1" damping="0" drest="0" '
                      'orientation="3" position="0"')), "orientation is 3"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_miphysics_import_refuses_unsupported_values(name: str) -> None:
    text, says = REFUSED[name]
    with pytest.raises(ModelError, match=says):
        score_text(parse(text), "", RATE)


@pytest.mark.usefixtures("work_folder")
@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--set", "rate=1e3"], "rate is a whole number"),
        (["--set", "rate=7"], "rate is a whole number"),
        (["--set", "K=7"], "no parameter 'K'; it has rate"),
        (["--feed", "in1=w.wav"], "w.wav"),
        (["--laws", "2019"], "are those of mi-gen"),
    ],
)
def test_miphysics_import_refuses_wrong_options(
    options: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("m.xml").write_text(BOTH)
    assert app.run(["import", "m.xml", "-o", "s.yaml", *options]) != 0
    assert says in capsys.readouterr().err
    assert not Path("s.yaml").exists()


@pytest.mark.parametrize("coding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_miphysics_of_utf16_imported_as_of_utf8(coding: str, tmp_path: Path) -> None:
    """With a mark of the order of bytes or without; what it says of its encoding is left out."""
    (tmp_path / "a.xml").write_text(BOTH, encoding="utf-8")
    head = '<?xml version="1.0" encoding="UTF-16"?>\n'
    bare = BOTH.partition("?>")[2].lstrip() if BOTH.startswith("<?xml") else BOTH
    expected = import_model(tmp_path / "a.xml").text
    (tmp_path / "a.xml").write_bytes((head + bare).encode(coding))
    assert import_model(tmp_path / "a.xml").text == expected


def test_is_model_recognises_miphysics() -> None:
    assert is_model(BOTH)
    assert not is_model("<html></html>")
    assert not is_model("@m mass 1 <MAT>")


def test_miphysics_damaged_files_refused_or_read() -> None:
    draw, read = random.Random(1), 0
    texts = [*IN_LINE.values(), *ACROSS.values(), *AXIS.values(), BOTH]
    pieces = [one for text in texts for one in re.findall(r"[\w.]+|\W", text)]
    pieces += ["1e308", "nan", "-0.0", "-1", "1e-320", "<", ">", "&", "]]>", "\x01", "9" * 99]
    for _ in range(300):
        result = re.findall(r"[\w.]+|\W", draw.choice(texts))
        for _ in range(draw.randint(1, 2)):
            index = draw.randrange(len(result))
            result[index] = draw.choice(pieces)
        text = "".join(result)
        try:
            score = score_text(parse(text), "", RATE)
        except ModelError:
            continue
        loaded = load("s.yaml", text=score)
        assert loaded.piece is not None, (text, loaded.diagnostics)
        read += 1
    assert read > 20
