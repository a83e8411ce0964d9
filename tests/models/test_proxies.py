"""Points between masses of macros: contacts, bows and plucks there, and signals that move them."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
import soundfile
from checked import check
from imported import rendered
from oracle import mims
from sweep import crossed, few

from ergon.workshop.api.model import ModelOptions, import_model
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.reading import parse
from ergon.workshop.models.mims.score import score_text

FRAMES = 1500
pytestmark = pytest.mark.usefixtures("work_folder")
MACROS = {
    "string": "@s string 9 1 0.3 0.002 0 0",
    "stiffString": "@s stiffString 9 1 0.3 0.05 0.002 0 0",
    "chain": "@s chain 7 1 0.3 0.002 0.0001 0 0",
    "mesh": "@s mesh 4 5 1 0.2 0.002 0 0",
    "closedMesh": "@s closedMesh 5 6 1 0.2 0.002 0 0",
    "a narrow closedMesh": "@s closedMesh 3 6 1 0.2 0.002 0 0",
    "cornerMesh": "@s cornerMesh 4 3 1 0.2 0.002 0 0",
}
LINKS = {
    "contact": "contact {point} @h 0.1 0.02",
    "contact from the other side": "contact @h {point} 0.1 0.02 -0.01",
    "nlContact": "nlContact {point} @h 0.01 5 0.2 0.01",
    "nlSpringDamper": "nlSpringDamper {point} @h 0.01 9 0.2 0.01",
    "nlSpring3": "nlSpring3 @h {point} 0.05 2 0.002",
    "pluck": "nlPluck @h {point} 0.05 0.05 0.004",
    "bow": "nlBow @h {point} 0.05 0.02",
    "springDamper": "springDamper {point} @h 0.05 0.004",
}


def model(macro: str, lines: str) -> str:
    """A heavy mass on a spring swings through the macro, whose middle is heard."""
    where = "0.4 0.6" if "esh" in macro else "0.4"
    return f"""{MACROS[macro]}
@g ground 0
@h mass 9 0.03 -20
@k springDamper @g @h 0.02 0.001
{lines}
@out1 posOutput [@s {where}]
@out2 posOutput @h
"""


def compared(text: str, signals: dict[str, np.ndarray], laws: str = "head") -> None:
    """A model and its score, to the last bits of rounding."""
    for name, signal in signals.items():
        signal[:] = np.float32(signal)
        soundfile.write(f"{name}.wav", signal, mims.RATE, subtype="FLOAT")
    Path("m.mdl").write_text(text)
    files = {name: f"{name}.wav" for name in signals}
    built = import_model("m.mdl", ModelOptions(dialect="v2", laws=laws, inputs=files))
    listened = mims.played(text, "v2", FRAMES / mims.RATE, laws, inputs=signals)
    sound = rendered(built.text, FRAMES / mims.RATE)
    assert np.abs(listened[:, 0]).max() > 1e-6
    assert np.abs(sound - listened).max() <= 1e-12 * np.abs(listened).max()


BETWEEN = [*product(LINKS, ["chain", "closedMesh"], ["head", "2019"])]


# Every third: all links, each macro with both laws.
@pytest.mark.parametrize(("link", "macro", "laws"), few(BETWEEN, BETWEEN[::3]))
def test_model_proxy_links_between_masses(macro: str, link: str, laws: str):
    point = "[@s 0.33 0.71]" if "esh" in macro else "[@s 0.33]"
    compared(model(macro, f"@l {LINKS[link].format(point=point)}"), {}, laws)


@pytest.mark.parametrize(("macro", "laws"), crossed([*MACROS], ["head", "2019"]))
def test_model_proxy_points_moved_by_signals(macro: str, laws: str):
    """Links, inputs and outputs; places beyond the ends are the ends."""
    sides = "{0} 0.9-{1}/2" if "esh" in macro else "{0}"
    first, other = sides.format("x+0.1", "y"), sides.format("1-y", "x")
    still = sides.replace("{0}", "0.5").format("", "x")
    lines = f"""@x audioParam @in3
@y audioParam @in4
@l contact [@s {first}] @h 0.1 0.02
@b nlBow @h [@s {other}] 0.05 0.02
@r springDamper [@s {first}] @h 0.01 0.002
@in1 frcInput [@s {other}]
@out3 posOutput [@s {first}]
@out4 posOutput [@s {still}]"""
    if laws == "2019":  # below 0 no place is
        lines = lines.replace("1-y", "0.2+0.5*y").replace("0.9-", "0.9-0.3*")
    t = np.arange(FRAMES) / mims.RATE
    push = 1e-3 * np.sin(2 * np.pi * 300 * t)
    slide = 0.45 + 0.6 * np.sin(2 * np.pi * 21 * t) * (1.0 if laws == "head" else 0.5)
    turn = 0.5 + 0.4 * np.sin(2 * np.pi * 33 * t + 1)
    compared(model(macro, lines), {"in1": push, "in3": slide, "in4": turn}, laws)


ELSEWHERE = {
    "string": "@s string 6 1 0.3 0.002 0.02 0",
    "chain": "@s chain 5 1 0.3 0.002 0.02 30",
    "closedMesh": "@s closedMesh 4 5 1 0.2 0.002 0.02 0",
}


@pytest.mark.parametrize("link", ["springDamper", "bow", "contact"])
@pytest.mark.parametrize("macro", ELSEWHERE)
def test_model_proxy_initial_jump_of_displaced_body(
    macro: str, link: str, monkeypatch: pytest.MonkeyPatch
):
    """In the first step it jumps to its body, which dampers feel."""
    monkeypatch.setitem(MACROS, macro, ELSEWHERE[macro])
    point = "[@s 0.13 0.71]" if "esh" in macro else "[@s 0.13]"
    compared(model(macro, f"@l {LINKS[link].format(point=point)}"), {})


def test_model_proxy_signal_without_file_is_zero():
    compared(model("string", "@x audioParam @in3\n@l nlSpring3 [@s x+0.4] @h 0.1 0.02 0"), {})


def test_model_proxies_at_one_place_share_module():
    lines = "@l contact [@s 0.33] @h 0.1 0\n@n nlBow @h [@s 0.33] 0.05 0.02"
    text = score_text(parse(model("string", lines), "v2", "m.mdl"))
    assert text.count("PROXY") == 1


REFUSED = {
    "two signals": (
        "@x audioParam @in1\n@y audioParam @in2\n@l contact [@s x*y] @h 1 0",
        "follows two signals",
        7,
    ),
    "a curve": ("@x audioParam @in1\n@l contact [@s x*x] @h 1 0", "not a straight line", 6),
}


@pytest.mark.parametrize("name", REFUSED)
def test_model_proxy_refuses_unsupported_signals(name: str):
    lines, message, line = REFUSED[name]
    with pytest.raises(ModelError, match=message) as raised:
        score_text(parse(model("string", lines), "v2", "m.mdl"))
    assert raised.value.line == line


def test_model_mesh_above_link_point_limit():
    """Its air is several links; the score is read."""
    text = "@s closedMesh 105 103 1 0.2 0.002 0.0001 0 0\n@in1 frcInput [@s 0.5 0.5]\n"
    score = score_text(parse(text + "@out1 posOutput [@s 0.31 0.7]\n", "v2", "m.mdl"))
    assert score.count("FRO") == 2
    assert check(score).piece is not None
