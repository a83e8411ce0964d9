"""Messages of pmpd as scores, beside an interpreter of its equations: sample for sample."""

import random
from pathlib import Path

import numpy as np
import pytest
import soundfile
from imported import rendered
from models_compared import off, pmpd_off, pmpd_score
from oracle import pmpd

from ergon.cli import app
from ergon.scores.reading.load import load
from ergon.workshop.api.model import ModelOptions, import_model
from ergon.workshop.models.errors import DialectError, ModelError
from ergon.workshop.models.pmpd.words import FORMS, Object

RATE = 44_100
SECONDS = 0.05
FRAMES = round(SECONDS * RATE)
LINEAR, TOUCHING = 1e-12, 1e-9  # largest error: where rounding does not grow, and where it may

STRING = "\n".join(
    [
        "mass 0",
        *(["mass 20 0"] * 12),
        "mass 0 0",
        *(f"link {at} {at + 1} 0.1 0.003" for at in range(13)),
        "pos 3 0.5",
        "outPos 0 7 1",
    ]
)
AUDIO = {
    "spring": "mass 0; mass 10 0.1; link 0 1 0.02 0.001; outPos 0 1 0.5",
    "spring of other sign": "mass 0; mass 10 0.1; mass 5 0; link 0 1 0.02; link 1 2 -0.001 -1e-5;"
    "link 0 2 0.01; outPos 0 1 1; outPos 1 2 2.5e-1",
    "string": STRING,
    "two outlets, sums": "pmpd~ 1 2\nmass 0\nmass 9 0.2\nmass 8 -.1\nlink 0 1 0.1 0.01\n"
    "link 1 2 0.05 0\noutPos 0 1 1\noutPosX 1 1 0.25\noutPos 1 2 3",
    "a force": "mass 0; mass 4; link 1 0 0.03 0.002; force 1 0.2; forceX 1 0.1; outPos 0 1 1",
    "all setters": "mass 1 0; mass 3 0; setM 0 0; link 0 1 1 1; setK 0 0.02; setD 0 0.003;"
    "posX 1 0.3; print; bang; setM 1 5; outPos 0 1 1",
    "reset": "mass 5 5; mass 0; link 0 1 1 1; outPos 0 0 1; reset; mass 0; mass 10 0.1;"
    "link 0 1 0.02 0.001; outPos 0 1 1",
}
TOUCHING_AUDIO = {
    "powers": "mass 0; mass 10 0.1; NLlink 0 1 0.02 0.001 1.5; mass 3 0.2; NLlink 1 2 0.01 0 3;"
    "outPos 0 1 1; outPos 1 2 1",
    "length": "mass 0; mass 10 0.1; NLlink 1 0 0.02 0.001 1 0.3; outPos 0 1 1",
    "root": "mass 0; mass 10 0.1; NLlink 0 1 0.002 0.001 0.5 0.01; outPos 0 1 1",
    "bounds": "mass 0; mass 1 0.9; NLlink 0 1 -0.001 0 1 0 -0.5 0.5;"
    "NLlink 0 1 0.01 0.0001 1 0 0.5 100;"
    "NLlink 0 1 0.01 0.001 1 0 -100 -0.5; outPos 0 1 1",
    "power within bounds": "mass 0; mass 1 0.9; NLlink 1 0 0.01 0.001 2 0.1 -0.2 0.7; outPos 0 1 1;"
    "link 0 1 0.001",
    "level": "mass 0; mass 1 0.9; NLlink 1 0 0.001 0 0; outPos 0 1 1",
    "setters": "mass 0; mass 1 0.9; NLlink 1 0; setNLK 0 0.01 2; setNLD 0 0.001; setNLL 0 0.2;"
    "setNLLMin 0 -1; setNLLMax 0 0.75; setNLK 0 0.02; setNLKPow 0 1.7; outPos 0 1 1",
}
CONTROL = {
    "spring": "mass fix 0 1 0; mass mob 1 10 0.1; link l 0 1 0.02 0.001; setPos mob 0.3; massPos 1",
    "a chain between classes": "mass fix 0 1 0\n"
    + "\n".join(["mass corde 1 50 0"] * 6)
    + "\nmass fix 0 1 0\n"
    + "\n".join(f"link souple {at} {at + 1} 10 1" for at in range(7))
    + "\nmass zero 0 1 0\nlink D2 zero corde 0 0\nsetD D2 0.01\nforce 3 5\nmassPos corde",
    "all of a class": "mass a 1 30 0.1; mass a 1 20 0; mass a 1 10 -0.1; mass b 0 1 0.3;"
    "link one a a 0.01 0.002; link two a b 0.02 0.01; link three 3 a 0.001; link four a 3 0.002;"
    "setPos 0 0.5; massPosL a",
    "reset": "mass a 1 2 1; reset; mass f 0 1 0; mass m 1 8 1; link l f m 0.2;pos m 1.4; massPos m",
    "damped put": "mass f 0 1 0; mass m 1 8 1; link l f m 0.2 0.05; setPos m 1.4; massPosX m",
    "setters": "mass f 0 1 0; mass m 1 8 1; mass m 1 2 2; link l f m 1 1; link k m m 1 1;"
    "setK l 0.1; setD k 0.01; setD 0 0.02; setD 1 0.02; setK 2 0.05; setL 2 -0.5; addL l 0.1;"
    "setM m 9; setM 2 7; setDEnv 1 0.004; setPow l 1; setSpeed 2 0.01; setForce m 3;"
    "setForce 1 0.2; addPos f 0.1; setFixed 2; setMobile 2; print; massPos m; bang; infosL; bang",
}
CONTROL = {name: text.replace("massPosX m", "massPosXL m") for name, text in CONTROL.items()}
K = "k resize 5; k 0 0 1 4 2 3; "
D = "d 0 0; d 1 0.002 0.001 0.004; "
TOUCHING_CONTROL = {
    "powers and bounds": "mass f 0 1 0; mass m 1 8 1; mass m 1 6 2; link l f m 0.01 0.001 1.5;"
    "link k 1 2 0.02 0.003 2 -3 -0.5; link j f 2 0.1 0.01 1 -2.5 0; setPos 2 1.7; massPos m",
    "a length from one place": "mass f 0 1 0; mass m 1 8 0; link l f m 0.1 0.01; setL l 0.2;"
    "setSpeed m 1e-3; massPos m",
    "nothing moves from one place": "mass f 0 1 0; mass m 1 8 0; link l f m 0.1 0.01; setL l 0.2;"
    "mass n 1 3 1; link k f n 0.1; setL k 0.5; massPos m; massPos n",
    "tables": K + "z resize 3; z 0 0 0 0;"
    "mass f 0 1 0; mass m 1 800 1; tabLink t f m k 2 z 1; massPos m",
    "viscous tables": K + D + "mass f 0 1 0; mass m 1 800 1; tabLink t f m k 2 d 0.02; setD t 3;"
    "mass m 1 900 0.5; tabLink u m m k 5 d 0.01; setK u 0.2; massPos m",
    "tables with a jump": D + "one 0 0.3; two 0 0.2 0.1 -0.1;"
    "mass f 0 1 0; mass m 1 9000 1; tabLink t m f two 2 d 0.1;"
    "tabLink t m f one 1 d 0.1; setK t 0.1; massPos m",
}


@pytest.mark.parametrize("name", AUDIO)
def test_pmpd_of_signals_without_touching(name: str) -> None:
    assert pmpd_off(AUDIO[name], "pmpd~", FRAMES) < LINEAR


@pytest.mark.parametrize("name", TOUCHING_AUDIO)
def test_pmpd_of_signals_with_laws(name: str) -> None:
    assert pmpd_off(TOUCHING_AUDIO[name], "pmpd~", FRAMES) < TOUCHING


@pytest.mark.parametrize("name", CONTROL)
def test_pmpd_of_bangs_without_touching(name: str) -> None:
    assert pmpd_off(CONTROL[name], "pmpd", FRAMES) < LINEAR


@pytest.mark.parametrize("name", TOUCHING_CONTROL)
def test_pmpd_of_bangs_with_laws(name: str) -> None:
    assert pmpd_off(TOUCHING_CONTROL[name], "pmpd", FRAMES) < TOUCHING


def test_pmpd_cases_cover_all_words() -> None:
    played = {
        "pmpd~": " ".join((*AUDIO.values(), *TOUCHING_AUDIO.values(), FED)),
        "pmpd": " ".join((*CONTROL.values(), *TOUCHING_CONTROL.values(), ASKED)),
    }
    for kind, forms in FORMS.items():
        words = set(played[kind].replace(";", " ").split())
        assert {word for word in forms if not {word, word.removesuffix("X")} & words} == set(), kind


# --- what is fed and heard ----------------------------------------------------------------------

FED = """
pmpd~ 2 2
mass 0
mass 10
mass 0 0.2
link 0 1 0.02 0.004
link 1 2 0.03 0.001
NLlink 0 1 0.01 0.002 2
inPos 1 0 0.5
inForce 0 1 0.25
inForce 0 2 9
outPos 1 1 2
outSpeed 0 1 1
"""
ASKED = "massPosMean m; massSpeedMean; massSpeed 0; massSpeedL m; massPosXL; massSpeedXL m"


@pytest.mark.usefixtures("work_folder")
def test_pmpd_inlets_position_and_force() -> None:
    t = np.arange(FRAMES) / RATE
    waves = [0.1 * np.cos(2 * np.pi * 300.0 * t), 0.2 * np.sin(2 * np.pi * 90.0 * t) ** 2]
    fed = {
        index: np.float64(np.float32(one)) for index, one in enumerate(waves)
    }  # as files hold them
    for index, samples in fed.items():
        soundfile.write(f"w{index}.wav", samples, RATE, subtype="FLOAT")
    Path("fed.txt").write_text(FED)
    asked = ModelOptions(inputs={"in0": "w0.wav", "in1": "w1.wav"})
    built = import_model("fed.txt", asked)
    assert (built.dialect, built.n_statements, built.unfed) == ("pmpd~", 12, ())
    exact = pmpd.audio(FED, FRAMES, fed)
    sound = rendered(built.text, SECONDS)
    assert np.abs(exact[:, 1]).max() > 0.1
    assert off(sound[1:, 1], exact[:-1, 1]) < LINEAR
    # A speed is that in the middle of a step, 7.5 samples late.
    assert off(sound[200:, 0], exact[200 - 8 : -8, 0]) < 1e-3


@pytest.mark.usefixtures("work_folder")
def test_pmpd_inlet_without_file_is_zero(capsys: pytest.CaptureFixture[str]) -> None:
    Path("fed.txt").write_text(FED)
    assert app.run(["import", "fed.txt", "-o", "s.yaml"]) == 0
    output = "".join(capsys.readouterr())
    assert "12 statements of pmpd~" in output
    assert "in0, in1 stay at 0" in output
    silent = {at: np.zeros(FRAMES) for at in (0, 1)}
    sound = rendered(Path("s.yaml").read_text(), SECONDS)
    assert off(sound[1:, 1], pmpd.audio(FED, FRAMES, silent)[:-1, 1]) < LINEAR


def test_pmpd_row_of_equal_masses_becomes_string() -> None:
    links = [f"link {at} {at + 1} 0.1 0.003" for at in range(13)]
    text = "\n".join(
        ["mass", *["mass 20 0.3"] * 6, *["mass 20"] * 2, *["mass 20"] * 4, "mass", *links]
        + ["link 3 4 0.02", "setK 8 0.2", "force 2 0.1", "force 10 0.2", "link 2 5 0.01"]
        + [f"outPos 0 {at} 0.5" for at in (2, 6, 7, 10)]
    )
    score = pmpd_score(text)
    assert "string: {STRING: {masses: 6, ends: free, M: 120, K: 0.1, Z: 0.003, X0: 0.3m}}" in score
    assert "string_2: {STRING: {masses: 4, ends: free, M: 80, K: 0.1, Z: 0.003}}" in score
    assert "m7: {MAS" in score
    assert "link13: {RES: {between: [string.3, string.2], K: 0.02}}" in score
    assert "string_1_kick: {to: model.string.1," in score
    assert score.count("{REF:") == 5  # at the ends, between the two, and one that is stiffer
    assert pmpd_off(text, "pmpd~", FRAMES) < LINEAR


def test_pmpd_mean_over_string_becomes_range() -> None:
    text = "mass f 0\n" + "mass s 1 9 0\n" * 5 + "mass t 1 8 0.1\n"
    text += "\n".join(f"link l {at} {at + 1} 0.2 0.01" for at in range(6))
    score = pmpd_score(text + "\nsetPos t 0.2")
    assert "SOX: [s.0..4, t]" in score
    exact = pmpd.bangs(text + "\nsetPos t 0.2", FRAMES)[:, 1:].mean(axis=1, keepdims=True)
    assert off(rendered(score, SECONDS), exact) < LINEAR


def test_pmpd_default_output_is_the_mean_position() -> None:
    text = "mass f 0 1 0; mass m 1 8 1; mass m 1 6 2; link l f m 0.1 0.01; setPos 2 1.7"
    exact = pmpd.bangs(text, FRAMES)[:, 1:].mean(axis=1, keepdims=True)
    for asked in ("", "; massPosMean m"):
        assert off(rendered(pmpd_score(text + asked), SECONDS), exact) < LINEAR


def test_pmpd_mass_speed_at_middle_of_step() -> None:
    text = "mass f 0 1 0; mass m 1 800 1; link l f m 0.1 0.01; setPos m 1.7; massSpeed m"
    steps = np.diff(pmpd.bangs(text, FRAMES)[:, [1]], axis=0)
    sound = rendered(pmpd_score(text), SECONDS)
    assert off(sound[100:], steps[100 - 8 : -7]) < 1e-4


def test_pmpd_messages_in_pure_data_syntax() -> None:
    text = CONTROL["spring"]
    for other in (
        text.replace(";", "\n"),
        text.replace(";", r" \,"),
        text.replace("; ", ";\r\n").replace(" 10 ", "\n10 "),
        "# a spring\npmpd 100 100\n" + text.replace(";", "\n"),
    ):
        assert pmpd_score(other) == pmpd_score(text)


# --- what is refused ----------------------------------------------------------------------------

B = "mass f 0 1 0\nmass m 1 1 1\n"
REFUSED = {
    "an unknown word": (3, f"{B}lnik l f m 1", "'lnik' is not a word of .pmpd.*'link'"),
    "a word of the other": (3, f"{B}NLlink 0 1 1", "one of .pmpd~."),
    "too few values": (3, f"{B}link l f", r"link is written link class a b \[K\] \[D\]"),
    "too many values": (1, "mass m 1 1 1 1", "here it has 5 values"),
    "no such class": (3, f"{B}link l f mm 1", "no masses are called 'mm'.*'m'"),
    "no such mass": (3, f"{B}link l 0 2 1", "mass is 2: a whole number from 0 to 1"),
    "half a mass": (3, f"{B}link l 0 0.5 1", "mass is 0.5"),
    "no mass yet": (1, "link l 0 1 1", "there is no mass yet"),
    "no number": (3, f"{B}link l f m 1k", "K is '1k', which is not a number"),
    "no finite number": (3, f"{B}link l f m 1e999", "which is not a number"),
    "a number as a class": (1, "mass 1 1 1 0", "a class is a word"),
    "itself": (3, f"{B}link l 1 1 1", "joins mass 1 to itself"),
    "an argument": (3, f"{B}force m $1", "'\\$1' stands for a number"),
    "a patch": (1, "#N canvas 0 0 450 300 12;", "this is a patch"),
    "no array": (3, f"{B}tabLink t f m k 1 d 1", "no values of the array 'd'|'k'"),
    "no values of an array": (
        4,
        f"{B}tabLink t f m k 1 d 1\nk 0 a",
        "an array is written k resize 3",
    ),
    "an array of no end": (4, f"{B}tabLink t f m k 1 d 1\nk resize 1e12", "a size is 1e\\+12"),
    "an array far away": (4, f"{B}tabLink t f m k 1 d 1\nk 1e12 1", "an index is 1e\\+12"),
    "a viscosity that jumps": (
        3,
        f"{B}tabLink t f m k 1 d 1\nk 0 1 2\nd 0 1 2",
        "viscosity that jumps",
    ),
    "ends of space": (3, f"{B}min -1", "space has no ends"),
    "later": (3, f"{B}delLink l", "change while it plays"),
    "behind a bang": (4, f"{B}bang\nforce m 1", "behind the first bang"),
    "a plane": (3, f"{B}tLink t f m 1", "two or three dimensions"),
    "a far mass": (1, "mass m 1 1 1e4", "x is 10000: a score holds up to 1000"),
    "a fast mass": (2, f"{B}setSpeed m 100", "the first step is"),
    "a far length": (3, f"{B}link l f m 1\nsetL l 1e4", "its length is 10000"),
    "no mass at all": (2, "pmpd\nbang", "it makes no mass"),
    "many masses asked for": (101, "mass m\n" * 100 + "massPos m", "more than 99 masses"),
    "many links": (2001, "mass m\n" * 2000 + "link l m m 1", "more than 200,000 masses"),
    "many words": (1, "k" + " 1" * 30_000, "at most 20,000 words"),
}
REFUSED_AUDIO = {
    "an inlet too many": (3, "pmpd~ 2 1\nmass\ninPos 2 0 1", "inlet is 2: a whole number"),
    "an outlet too many": (2, "mass 1\noutPos 99 0 1", "outlet is 99"),
    "finer steps": (1, "pmpd~ 1 1 4", "4 steps in a sample"),
    "no object": (1, "pmpd~ one", "pmpd~ is written"),
    "a mass that moves both ways": (2, "mass 1\ninPos 0 0 1", "a weight of 0"),
    "an inlet that is heard": (3, "mass\ninPos 0 0 1\noutPos 0 0 1", "one sample before all"),
    "a gain below 0": (2, "mass 1\noutPos 0 0 -1", "none below 0"),
    "viscosity within bounds at an inlet": (
        3,
        "mass\nmass 1\nNLlink 0 1 1 1 1 0 -1 1\ninPos 0 0 1",
        "on a mass that an inlet moves",
    ),
    "a word of the other": (2, "mass 1\nsetPow 0 1", "one of .pmpd."),
    "no NLlink": (2, "mass 1\nsetNLK 0 1", "there is no NLlink yet"),
}


@pytest.mark.parametrize(
    ("kind", "name"), [*(("pmpd", one) for one in REFUSED), *(("pmpd~", a) for a in REFUSED_AUDIO)]
)
def test_pmpd_import_refuses_unsupported_with_line(kind: Object, name: str) -> None:
    line, text, says = (REFUSED if kind == "pmpd" else REFUSED_AUDIO)[name]
    with pytest.raises(ModelError, match=says) as refused:
        pmpd_score(text, kind)
    assert refused.value.line == line


@pytest.mark.usefixtures("work_folder")
@pytest.mark.parametrize(
    ("text", "says", "options"),
    [
        ("mass\nmass 1\nlink 0 1 1", "write the object as the first line", []),
        ("pmpd2d\nmass m 1 1 0 0", "objects of one dimension", []),
        ("pmpd\nmass m", "these messages are for [pmpd]", ["--dialect", "pmpd~"]),
        ("pmpd\nmass m", "have no parameters", ["--set", "K=1"]),
        ("pmpd\nmass m", "are those of mi-gen", ["--laws", "2019"]),
        ("pmpd~\nmass", "the model has no input 'in1'", ["--feed", "in1=w.wav"]),
    ],
)
def test_pmpd_import_refuses_wrong_options(
    text: str, says: str, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    soundfile.write("w.wav", np.zeros(10), RATE, subtype="FLOAT")
    Path("list.txt").write_text(text)
    assert app.run(["import", "list.txt", "-o", "s.yaml", *options]) == 2
    assert says in capsys.readouterr().err
    assert not Path("s.yaml").exists()


def test_pmpd_list_valid_in_both_objects() -> None:
    text = "mass\nmass 1\nlink 0 1 1"
    with pytest.raises(DialectError):
        pmpd_score(text)
    assert "REF" not in pmpd_score(text, "pmpd~")


def test_pmpd_damaged_lists_refused_or_read() -> None:
    texts = [*AUDIO.values(), *TOUCHING_AUDIO.values(), *CONTROL.values(), FED]
    texts += TOUCHING_CONTROL.values()
    words = [word for text in texts for word in text.replace(";", " ; ").split()]
    words += ["1e308", "nan", "-0", "1e-320", "$0", ",", "]", "{", '"', "'", "#", "a:b", "x" * 99]
    draw, read = random.Random(1), 0
    for _ in range(300):
        spoiled = draw.choice(texts).replace(";", " ; ").replace("\n", " ; ").split(" ")
        for _ in range(draw.randint(1, 2)):
            index = draw.randrange(len(spoiled))
            spoiled[index : index + draw.randint(0, 2)] = draw.choices(words, k=draw.randint(0, 2))
            spoiled = spoiled or ["mass"]
        try:
            score = pmpd_score(" ".join(spoiled))
        except ModelError:
            continue
        result = load("s.yaml", text=score)
        assert result.piece is not None, (spoiled, result.diagnostics)
        read += 1
    assert read > 20


@pytest.mark.parametrize(
    ("box", "words"),
    [
        ("#X obj 50 50 pmpd~ 1 1;", "a patch of Pure Data with pmpd~, and"),
        ("#X obj 5 5 pmpd3d;\n#X obj 5 9 pmpd2d;", "with pmpd2d, pmpd3d, and"),
        ("#X obj 50 50 osc~ 440;", "without an object of pmpd"),
    ],
)
def test_pure_data_patches_are_recognised(tmp_path: Path, box: str, words: str) -> None:
    path = tmp_path / "patch.pd"
    head = "#N canvas 0 0 450 300 10;\n"
    path.write_text(f"{head}{box}\n#X msg 50 20 mass 20;\n#X connect 1 0 0 0;\n")
    with pytest.raises(ModelError, match=words) as caught:
        import_model(path)
    assert "write the messages that its pmpd object gets into a text" in str(caught.value)
