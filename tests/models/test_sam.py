"""Models of Synth-A-Modeler as scores, beside an interpreter of its library: sample for sample."""

import random
import re
from pathlib import Path

import numpy as np
import pytest
import soundfile
from imported import rendered
from models_compared import off, sam_off, sam_score
from oracle import sam
from sweep import few

from ergon.cli import app
from ergon.scores.reading.load import load
from ergon.workshop.api.model import ModelOptions, import_model
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.sam.expressions import parse_definitions
from ergon.workshop.models.sam.reading import Code
from ergon.workshop.models.sam.values import LIBRARY, Values
from ergon.workshop.models.sam.words import LINKS, MASSES, REFUSED, is_model

RATE = 44_100
LINEAR, TOUCHING = 1e-12, 1e-10  # largest error: without contacts, and with some


def model(*lines: str) -> str:
    return "\n".join(line + ";" for line in lines)


G = "ground(0.0),g"
STRING = model(
    G,
    "ground(0.0),h",
    *(f"mass(0.001,0.0,{0.5 if i == 3 else 0.0}),m{i}" for i in range(8)),
    *(f"link(2000.0,0.002,0.0),l{i},m{i},m{i + 1}" for i in range(7)),
    "link(2000.0,0.002,0.0),left,g,m0",
    "link(2000.0,0.002,0.0),right,m7,h",
)
BELL = "resonators(200.0,0.3,0.01,331.0,0.2,0.004,1234.5,0.1,0.02),r"
MODELS = {
    "a spring": model("mass(0.01,0.02,0.0),m", G, "link(200.0,0.0,0.0),l,m,g"),
    "a spring and a damper": model("mass(0.01,0.02,0.5),m", G, "link(200.0,0.02,0.0),l,m,g"),
    "the other way round": model("mass(0.01,0.02,0.5),m", G, "link(200.0,0.02,0.0),l,g,m"),
    "a damper": model("mass(0.01,0.02,0.5),m", G, "link(0.0,0.3,0.0),l,m,g"),
    "a damper from a ground elsewhere": model("mass(0.01,0.0,0.0),m", "ground(0.03),g",
                                              "link(0.0,0.3,0.0),l,m,g"),
    "nothing between": model("mass(0.01,0.02,0.5),m", G, "link(0.0,0.0,0.0),l,m,g"),
    "a free mass": model("mass(0.01,0.02,0.5),m"),
    "an offset": model("mass(0.01,0.02,0.0),m", G, "link(200.0,0.0,0.005),l,m,g"),
    "an offset of a damped spring": model("mass(0.01,0.02,0.1),m", G,
                                          "link(200.0,0.02,-0.005),l,m,g"),
    "offsets between masses": model(
        "mass(0.01,0.02,0.5),m", "mass(0.02,-0.02,-0.5),p", "ground(0.01),g",
        "link(200.0,0.02,0.003),l,m,g", "link(300.0,0.01,-0.004),j,p,m"),
    "a ground elsewhere": model("mass(0.01,0.0,0.0),m", "ground(0.03),g",
                                "link(200.0,0.02,0.01),l,m,g"),
    "a string": STRING,
    "two links of one pair": model("mass(0.01,0.02,0.0),m", G, "link(200.0,0.01,0.0),l,m,g",
                                   "link(100.0,0.01,0.001),j,g,m"),
    "energy": model("mass(0.01,0.001,0.0),m", G, "link(200.0,-0.005,0.0),l,m,g"),
    "a stiffness below 0": model("mass(0.01,0.001,0.0),m", G, "link(-2.0,0.0,0.002),l,m,g",
                                 "link(200.0,0.01,0.0),j,g,m"),
    "a port at rest": model("mass(0.01,0.02,0.0),m", "port(),d", "link(200.0,0.02,0.0),l,m,d"),
    "a resonator": model("mass(0.01,0.02,0.0),m", "resonators(200.0,0.3,0.01),r",
                         "link(100.0,0.1,0.0),l,m,r"),
    "a resonator that an offset presses": model(
        "mass(0.01,0.02,0.0),m", "resonators(200.0,0.3,0.01),r", "link(100.0,0.1,0.01),l,m,r"),
    "a resonator of 15 kHz": model("mass(0.01,0.02,0.0),m", "resonators(15000.0,0.02,0.0001),r",
                                   "link(100.0,0.1,0.0),l,m,r"),
    "two resonators": model("resonators(440.0,0.2,0.01),q", "resonators(300.0,0.3,0.02),r",
                            "ground(0.01),g", "link(100.0,0.02,0.0),l,q,r",
                            "link(300.0,0.0,0.0),j,g,q"),
    "three resonances": model("mass(0.01,0.02,0.0),m", BELL, "link(100.0,0.1,0.0),l,m,r"),
    "resonances that a string drives": STRING + "\n" + model(BELL, "link(90.0,0.0,0.0),b,m5,r"),
    "parameters": "faustcode: R2=2.0*damping;\nfaustcode:stiff=hslider(\"Stiffness # [N/m]\",220.0,"
    "0.0,300.0,10.0);\nfaustcode: damping=0.01; half = stiff/2.0; // half of it\n"
    + model("mass((0.02+0.01)/3.0,0.02,0.5),m", G, "link(stiff-half,R2*(1.0-0.5),0.0),l,m,g"),
    "integers, powers and signs": "faustcode: a=3;\n"
    + model("mass(0.01,-0.02,+0.5),m".replace("+", ""), G, "link(a^2*10+a*-1,0.2^a,-0.001),l,m,g"),
}  # fmt: skip
TOUCHES = {
    "a touch": model("mass(0.01,-0.02,5.0),m", "ground(0.01),g", G.replace("g", "h", 2).replace(
        "hround", "ground"), "link(100.0,0.0,0.0),l,m,h", "touch(5000.0,0.2,0.002),t,m,g"),
    "a touch from above": model("mass(0.01,0.02,-5.0),m", G, "link(100.0,0.0,0.0),l,m,g",
                                "touch(5000.0,0.2,0.002),t,g,m"),
    "a touch without damping": model("mass(0.01,0.02,-5.0),m", G, "link(100.0,0.0,0.0),l,m,g",
                                     "touch(5000.0,0.0,0.0),t,g,m"),
    "a touch that is closed at first": model("mass(0.01,0.02,0.0),m", G,
                                             "link(100.0,0.0,0.0),l,m,g",
                                             "touch(5000.0,0.2,-0.004),t,m,g"),
    "a touch that is closed at 0": model("mass(0.01,-0.02,0.0),m", G, "link(100.0,0.0,0.0),l,m,g",
                                         "touch(5000.0,0.2,-0.004),t,m,g"),
    "a touch that gives energy": model("mass(0.01,0.02,0.0),m", G, "link(100.0,0.01,0.0),l,m,g",
                                       "touch(1000.0,-0.02,0.001),t,m,g"),
    "a touch that pulls": model("mass(0.01,0.02,0.0),m", G, "link(100.0,0.01,0.0),l,m,g",
                                "touch(-20.0,0.02,0.001),t,g,m"),
    "a touch of resonances": model("mass(0.01,0.02,0.0),m", G, BELL, "link(100.0,0.0,0.0),j,m,g",
                                   "touch(2000.0,0.1,0.0),t,m,r"),
    "a stick on a string": STRING + "\n" + model("mass(0.002,-0.001,0.4),s",
                                                 "touch(900.0,0.01,0.0),t,s,m4"),
    "two that meet": model("mass(0.01,0.02,-1.0),m", "mass(0.02,-0.02,1.0),p",
                           "touch(900.0,0.1,0.001),t,p,m"),
}  # fmt: skip


@pytest.mark.parametrize("name", few(MODELS, [*MODELS][::2]))
def test_sam_model_without_contacts(name: str) -> None:
    assert sam_off(MODELS[name], 0.1) < LINEAR


@pytest.mark.parametrize("name", TOUCHES)
def test_sam_model_with_contacts(name: str) -> None:
    assert sam_off(TOUCHES[name], 0.1) < TOUCHING


@pytest.mark.slow
@pytest.mark.parametrize("name", [*MODELS, *TOUCHES])
def test_sam_model_for_one_second(name: str) -> None:
    assert sam_off((MODELS | TOUCHES)[name], 1.0) < (LINEAR if name in MODELS else 1e-5)


def test_sam_cases_cover_all_words() -> None:
    text = "\n".join([*MODELS.values(), *TOUCHES.values()])
    assert {word for word in (*MASSES, *LINKS) if f"{word}(" not in text} == set()


# --- the score ----------------------------------------------------------------------------------

WRITTEN = """\
# A drum of a friend.
#
# It may be copied.

faustcode: k=hslider("Stiffness [N/m]",250.0,0.0,400.0,10.0); // of all springs
faustcode: vol=20.0*hslider("Volume",2.0,0.0,9.0,0.1) : onePoleBLT(10.0);
faustcode: outputDSP=highpass(4,30.0);
# what is struck
mass(0.01,0.0,0.5),head; # pos 12,40
ground(0.0),rim; # pos 1,2 held
link(k*2.0,0.02,0.0),skin,head,rim; # the skin
port(),dev1;
touch(k,0.01,0.003),stick,dev1,head;
## comment("play|it softly",16,ff000000),c1; # pos 1,1
display,d0,head;
audioout,left,head*(vol):outputDSP;
audioout,right,0.0; # nothing
"""


def test_sam_import_refuses_too_large_number_with_line() -> None:
    text = WRITTEN.replace("250.0,", "250.1e90,")
    with pytest.raises(ModelError, match="k: the number is too large") as refused:
        sam_score(text)
    assert refused.value.line == 5


def test_sam_score_comments_units_and_names() -> None:
    score = sam_score(WRITTEN)
    for line in (
        "# A drum of a friend.",
        "# It may be copied.",
        "  k: 250  # Stiffness [N/m]  of all springs",
        "      # what is struck",
        "      head: {MAS: {M: 0.01*fs*fs, V0: 0.5m/s}}",
        "      skin: {REF: {between: [head, rim], K: k*2.0, Z: 0.02*fs}}  # the skin",
        "      dev1: {SOL: {}}  # a port, where a device was",
        "      stick: {BUT: {between: [dev1, head], K: k, Z: 0.01*fs, gap: 0.003m}}",
        "      left: {SOX: head}",
        "    - {from: model.left, to: 1, gain: x40, highpass: 30Hz}  # highpass(4, 30) in the "
        "model; a route has one of order 2",
        "  channels: 2",
    ):
        assert f"\n{line}\n" in score, line
    assert "pos 1" not in score
    assert "vol" not in score.split("let:")[1].split("instruments:")[0]


def test_sam_port_as_key_in_score() -> None:
    score = sam_score(WRITTEN)
    key = re.search(r"^# (keys: .+)$", score, flags=re.MULTILINE)
    assert key is not None
    played = re.sub(r"      dev1: .+\n", "", score) + key[1] + "\n"
    played += "players: {ada: {key: dev1}}\ngestures: {tap: 0mm@0s smooth 5mm@50ms 0mm@100ms}\n"
    result = load("s.yaml", text=played + "parts: {ada: [{at: 0s, play: tap}]}\n")
    assert result.piece is not None, result.diagnostics


def test_sam_parameter_override() -> None:
    assert "  k: 300  # hslider" in sam_score(WRITTEN, k=300.0)
    with pytest.raises(ModelError, match="no parameter 'kk'; did you mean 'k'"):
        sam_score(WRITTEN, kk=1.0)


def test_sam_channels_sum_positions_and_forces() -> None:
    text = MODELS["offsets between masses"] + "\nport(),d;\nlink(50.0,0.01,0.0),q,m,d;\n"
    listened = "faustcode: vol = -6.0 : db2linear; pan(x) = x*0.25 + 0.5;\n"
    listened += "audioout,a,(m*2.0 + p:*(3.0))*vol;\naudioout,b,(p - m)/(0.5+0.5);\n"
    listened += "audioout,c,-(1.0)*(l*pan(2.0))-j;\naudioout,e,d:_:/(2.0);\n"
    listened = listened.replace("-(1.0)*", "-1.0*")
    sound = rendered(sam_score(text + listened), 0.05)
    x = sam.played(text, len(sound))
    vol = 10.0 ** (-6.0 / 20.0)
    # `:` binds more loosely than + and *.
    assert off(sound[:, 0], (2.0 * x["m"] + x["p"]) * 3.0 * vol) < LINEAR
    assert off(sound[:, 1], x["p"] - x["m"]) < LINEAR
    assert off(sound[1:-1, 2], (-1.0 * x["l"] - x["j"])[2:]) < LINEAR
    assert off(sound[1:-1, 3], x["q"][2:] / 2.0) < LINEAR


@pytest.mark.usefixtures("work_folder")
@pytest.mark.parametrize("first", [0.0, 0.01])
def test_sam_ports_driven_by_files(first: float, capsys: pytest.CaptureFixture[str]) -> None:
    text = model("mass(0.01,0.02,0.0),m", G, "port(),d", "port(),e", "link(200.0,0.02,0.001),l,m,d",
                 "touch(900.0,0.05,0.0),t,e,m", "link(20.0,0.01,0.0),j,g,m",
                 "audioout,a,m", "audioout,b,d")  # fmt: skip
    n = 4410
    path = first + 0.005 * np.sin(2 * np.pi * 30.0 * np.arange(n) / RATE)
    path = path.astype(np.float32).astype(float)
    soundfile.write("d.wav", path, RATE, subtype="FLOAT")
    Path("m.mdl").write_text(text)
    assert app.run(["import", "m.mdl", "-o", "s.yaml", "--feed", "d=d.wav"]) == 0
    output = "".join(capsys.readouterr())
    assert "statements of sam" in output
    assert "e stays at 0" in output
    sound = rendered(Path("s.yaml").read_text(), n / RATE)
    # A score's file begins where the model's second sample is.
    exact = sam.played(text.split("\naudioout")[0] + "\n", n, {"d": [0.0, *path[:-1]]})
    assert off(sound[:, 0], exact["m"]) < TOUCHING
    assert off(sound[1:-1, 1], exact["l"][2:]) < TOUCHING


# --- expressions --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1.0+2.0*3.0", 7.0),
        ("2.0^3.0", 8.0),
        ("7.0-2.0-1.0", 4.0),
        ("8.0/2.0/2.0", 2.0),
        ("7.5%2.0", 1.5),
        ("-3.0*-2.0", 6.0),
        ("2.0 : *(3.0) : +(1.0)", 7.0),
        ("2.0 : -(0.5) : /(3.0)", 0.5),
        ("69.0 : mtof", 440.0),
        ("20.0 : db2linear", 10.0),
        ("int(3.7)", 3.0),
        ("pow(2.0,10.0)", 1024.0),
        ("min(2.0,max(1.0,5.0))", 2.0),
        ("hslider(\"a, b\",4.0,0.0,9.0,1.0) : onePoleBLT(2.0)", 4.0),
        ("nentry(\"n\",3,0,9,1)*checkbox(\"on\")", 0.0),
        ("twice(1.5)", 3.0),
        ("preset((1.0,2.0,4.0))", 4.0),
        ("fs", 44_100.0),
        ("2.0*PI", 2.0 * np.pi),
    ],
)  # fmt: skip
def test_sam_faust_expression_values(text: str, value: float) -> None:
    code = [
        Code("twice(x) = x*2.0;", 1),
        Code("preset(list)=rdtable(n, mytake(presetInitIndex,n,list), at);", 2),
        Code("at = int(nentry(\"p\",2,0,2,1));", 2),
        Code("n = 3; // of presets", 3),
    ]  # fmt: skip
    values = Values({**LIBRARY, **parse_definitions(code)})
    assert values.number(text, 1, "it") == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("first", "more"),
    [
        ("k0=1.0", "k{0}=(k{1}+1.0)*(1.0+(k{1}*2.0))"),
        ("k0(x)=x", "k{0}(x)=((k{1}(x)))"),
        ("k0=*(2.0)", "k{0}=((k{1}))"),
    ],
)
def test_sam_import_refuses_deeply_nested_definitions(first: str, more: str) -> None:
    lines = [first, *(more.format(at, at - 1) for at in range(1, 3000))]
    code = "".join(f"faustcode: {line};\n" for line in lines)
    used = {"k0=1.0": "k2999", "k0(x)=x": "k2999(1.0)", "k0=*(2.0)": "1.0:k2999"}[first]
    with pytest.raises(ModelError, match="nested too deeply"):
        sam_score(code + f"mass({used},0.0,0.0),m;")


def test_sam_names_colliding_with_score_names() -> None:
    names = "faustcode: sixty=200.0; a=1.0; A=2.0; e=3.0; bar=0.5; m=1.0;\n"
    text = names + model("resonators(sixty*a*A*e*bar*m,1.0,1.0),still", "ground(0.0),stillear",
                         "mass(1.0,0.1,0.0),model", "link(9.0,0.1,0.0),heard,still,model",
                         "audioout,x,-still", "audioout,y,model", "audioout,no,heard")  # fmt: skip
    result = load("s.yaml", text=sam_score(text))
    assert result.piece is not None, result.diagnostics


# --- what is refused ----------------------------------------------------------------------------

A = "mass(0.01,0.0,0.0),m;\nground(0.0),g;\n"
WRONG = {
    "an unknown word": (3, f"{A}lnik(1.0,0.1,0.0),l,m,g;", "'lnik' is not a word.*'link'"),
    "no semicolon": (3, f"{A}link(1.0,0.1,0.0),l,m,g", "ends with a semicolon"),
    "too few values": (3, f"{A}link(1.0,0.1),l,m,g;", r"written link\(k, R, o\), name, a, b"),
    "too many values": (3, f"{A}port(1.0),d;", r"port is written port\(\), name"),
    "half a resonator": (3, f"{A}resonators(1.0,1.0,1.0,2.0),r;", "resonators is written"),
    "no end": (3, f"{A}link(1.0,0.1,0.0),l,m;", "link is written"),
    "no such mass": (3, f"{A}link(1.0,0.1,0.0),l,m,gg;", "no mass is called 'gg'.*'g'"),
    "itself": (3, f"{A}link(1.0,0.1,0.0),l,m,m;", "joins 'm' to itself"),
    "a name twice": (3, f"{A}port(),m;", "'m' is the name of line 1 too"),
    "a name with a sign": (3, f"{A}port(),m_1;", "'m_1' is not a name"),
    "a name of Faust too": (2, "faustcode: m=1.0;\nport(),m;", "is a name of a line of Faust too"),
    "an open parenthesis": (3, f"{A}link((1.0,0.1,0.0),l,m,g;", "a parenthesis is not closed"),
    "a group": (3, f"{A}port( ),d,(groupA);", r"the group \(groupA\) says nothing"),
    "no mass at all": (1, "# nothing", "no statement"),
    "no weight": (1, "mass(0.0,0.0,0.0),m;", "m is 0: a mass is above 0"),
    "a far mass": (1, "mass(1.0,1e4,0.0),m;", "x0 is 10000: a score holds up to 1000"),
    "a fast mass": (1, "mass(1.0,0.0,1e7),m;", "the speed at the beginning is 1e\\+07"),
    "a frequency too high": (1, "resonators(23000.0,1.0,1.0),r;", "f is 23000 Hz"),
    "no decay": (1, "resonators(230.0,0.0,1.0),r;", "T60 is 0"),
    "an unknown parameter": (3, f"{A}link(kk,0.1,0.0),l,m,g;", "nothing is called 'kk'"),
    "a parameter of itself": (1, f"faustcode: k=k+1.0;\n{A}link(k,0.1,0.0),l,m,g;", "by itself"),
    "a circle": (
        2, f"faustcode: k=2.0*j;\nfaustcode: j=k;\n{A}link(k,0.1,0.0),l,m,g;", "by itself"),
    "a function of itself": (
        1, f"faustcode: k(x)=k(x)+1.0;\n{A}link(k(1.0),0.1,0.0),l,m,g;", "by itself"),
    "a parameter twice": (2, f"faustcode: k=1.0;\nfaustcode: k=2.0;\n{A}", "defined in line 1 too"),
    "a parameter without end": (1, f"faustcode: k=1.0\n{A}", "ends with a semicolon"),
    "a rate": (1, f"faustcode: fs=48000.0;\n{A}", "fs is the rate of the library"),
    "a division by 0": (3, f"{A}link(1.0/0.0,0.1,0.0),l,m,g;", "divides by 0"),
    "a number without end": (3, f"{A}link(1e999,0.1,0.0),l,m,g;", "too large"),
    "a position as a stiffness": (3, f"{A}link(m,0.1,0.0),l,m,g;", "'m' is not a number"),
    "a word of Faust": (3, f"{A}link(rint(2.0),0.1,0.0),l,m,g;", "of Faust 'rint' is not read"),
    "an unread sign": (3, f"{A}link(2.0<:_,0.1,0.0),l,m,g;", "not read here"),
    "nested": (3, f"{A}link({'(' * 60}1.0{')' * 60},0.1,0.0),l,m,g;", "inside one another"),
    "no expression": (3, f"{A}audioout,a,;", "an expression is missing"),
    "a product": (3, f"{A}audioout,a,m*m;", "a product of sounds"),
    "a constant": (3, f"{A}audioout,a,m+1.0;", "a constant of 1 is not a sound"),
    "a low-pass": (3, f"{A}audioout,a,m:onePoleBLT(2.0);", "a low-pass of a sound"),
    "filters of parts": (
        4, f"{A}mass(1.0,0.0,0.0),p;\naudioout,a,(m:highpass(1,20.0))+p;", "filters of their own"),
    "a list": (3, f"{A}audioout,a,(m,m);", "one channel"),
    "both signs": (
        5, f"{A}link(1.0,0.1,0.0),l,m,g;\naudioout,a,l;\naudioout,b,-l;", "with both signs"),
    "a MODES that is pressed": (
        3, f"{A}{BELL};\nlink(1.0,0.1,0.01),l,m,r;", "presses on these resonators"),
    **{
        word: (3, f"{A}{word}(1.0,1.0,1.0,1.0),l,m,g;", f"{word}: ")
        for word in REFUSED
        if word != "controladjust"
    },
    "controladjust": (3, f"{A}controladjust,k,l:2;", "changes nothing"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_sam_import_refuses_unsupported_with_line(name: str) -> None:
    line, text, says = WRONG[name]
    with pytest.raises(ModelError, match=says) as refused:
        sam_score(text)
    assert refused.value.line == line


def test_is_model_recognises_sam() -> None:
    assert is_model("# a comment\n\n  link(1.0,0.1,0.0),l,m,g;")
    assert is_model("faustcode: k=1.0;")
    assert is_model("audioout,a,m;")
    assert not is_model("@m mass 1 0 0")
    assert not is_model("mass 1 0")
    assert not is_model("")


@pytest.mark.usefixtures("work_folder")
@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--laws", "2019"], "the laws of 2019 are those of mi-gen"),
        (["--set", "k=much"], "much is not a number"),
        (["--set", "kk=1"], "the model has no parameter 'kk'"),
        (["--feed", "dev2=w.wav"], "the model has no input 'dev2'"),
        (["--dialect", "v1"], "m.mdl:"),
    ],
)
def test_sam_import_refuses_wrong_options(
    options: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    soundfile.write("w.wav", np.zeros(10), RATE, subtype="FLOAT")
    Path("m.mdl").write_text(WRITTEN)
    assert app.run(["import", "m.mdl", "-o", "s.yaml", *options]) == 2
    assert says in capsys.readouterr().err
    assert not Path("s.yaml").exists()


@pytest.mark.usefixtures("work_folder")
def test_sam_import_with_python_options() -> None:
    Path("m.mdl").write_text(WRITTEN)
    built = import_model("m.mdl", ModelOptions(dialect="sam", values={"k": "1e2"}))
    assert (built.dialect, built.n_statements, built.unfed) == ("sam", 11, ("dev1",))
    assert "  k: 100  #" in built.text


def spoiled(seed: int) -> str:
    texts = [*MODELS.values(), *TOUCHES.values(), WRITTEN]
    pieces = [one for text in texts for one in re.findall(r"\w+|\W", text)]
    pieces += [
        "1e308",
        "nan",
        "-0.0",
        "1e-320",
        "((",
        "))",
        '"',
        "'",
        "{",
        "//",
        "#",
        "\n",
        "9" * 99,
    ]
    draw = random.Random(seed)
    result = re.findall(r"\w+|\W", draw.choice(texts))
    for _ in range(draw.randint(1, 2)):
        index = draw.randrange(len(result))
        result[index : index + draw.randint(0, 2)] = draw.choices(pieces, k=draw.randint(0, 2))
    return "".join(result)


@pytest.mark.parametrize("first", few(range(0, 3000, 300), 1))
def test_sam_damaged_models_refused_or_read(first: int) -> None:
    read = 0
    for seed in range(first, first + 300):
        text = spoiled(seed)
        try:
            score = sam_score(text)
        except ModelError:
            continue
        result = load("s.yaml", text=score)
        assert result.piece is not None, (text, result.diagnostics)
        read += 1
    assert read > 20
