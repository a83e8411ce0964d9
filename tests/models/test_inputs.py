"""Inputs of models that files feed, and the command."""

from pathlib import Path

import numpy as np
import pytest
import soundfile
from commands import records
from imported import rendered
from oracle import mims
from sweep import crossed

from ergon.api.errors import OptionError
from ergon.cli import app
from ergon.workshop.api.model import ModelOptions, import_model
from ergon.workshop.models.errors import ModelError

FRAMES = 4410
pytestmark = pytest.mark.usefixtures("work_folder")
HAND = """
@in1 posInput 0
@in2 frcInput @m
@m mass 1 0.01 0
@g ground 0
@s springDamper @g @m 0.01 0.001
@c springDamper @in1 @m 0.02 0.003
@out1 posOutput @m
@out2 posOutput @in1
"""


def wave(name: str, samples: np.ndarray, rate: int = mims.RATE) -> None:
    soundfile.write(name, samples, rate, subtype="FLOAT")


def path_and_push() -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(FRAMES) / mims.RATE
    path = 0.01 * np.sin(2 * np.pi * 90.0 * t) ** 2
    push = 1e-4 * np.sin(2 * np.pi * 300.0 * t)
    return np.float64(np.float32(path)), np.float64(np.float32(push))  # as files hold them


def test_model_inputs_position_and_force():
    path, push = path_and_push()
    wave("path.wav", path)
    wave("push.wav", push)
    Path("m.mdl").write_text(HAND)
    asked = ModelOptions(dialect="v2", inputs={"in1": "path.wav", "in2": "push.wav"})
    listened = mims.played(HAND, "v2", FRAMES / mims.RATE, inputs={"in1": path, "in2": push})
    sound = rendered(import_model("m.mdl", asked).text, FRAMES / mims.RATE)
    assert np.abs(sound - listened).max() <= 1e-12 * np.abs(listened).max()
    still = import_model("m.mdl", ModelOptions(dialect="v2")).text
    listened = mims.played(HAND, "v2", FRAMES / mims.RATE)
    sound = rendered(still, FRAMES / mims.RATE)
    assert np.abs(sound - listened).max() <= 1e-12 * np.abs(listened).max()


JUMPS = {
    "damper": ("v2", "@l damper @m @in1 0.01"),
    "turned": ("v2", "@l springDamper @in1 @m 0.02 0.003"),
    "closed contact": ("v2", "@l contact @in1 @m 0.02 0.004 -0.001"),
    "open contact": ("v2", "@l contact @m @in1 0.02 0.004 0.0"),
    "nlContact": ("v2", "@l nlContact @in1 @m 0.02 5 0.2 0.005 0.0"),
    "nlSpringDamper": ("v2", "@l nlSpringDamper @m @in1 0.01 20 0.2 0.003"),
    "nlSpring3 of MIMS": ("v1", "@l nlSpring3 @m @in1 0.01 20 0.003"),
    "bow": ("v2", "@l nlBow @m @in1 0.02 0.05"),
    "smooth bow": ("v2", "@l nlBow @in1 @m 0.02 0.05 1"),
    "pluck": ("v2", "@l nlPluck @m @in1 0.01 0.3 0.002"),
    "on a string": ("v2", "@t string 6 1 0.05 0.001 0 0\n@l springDamper @in1 [@t 0.3] 0.02 0.003"),
    "beside a fixed point": ("v2", "@t string 6 1 0.05 0.001 0 0\n@l damper [@t 0.1] @in1 0.02"),
    "contact on a string": (
        "v2",
        "@t string 6 1 0.05 0.001 0 0\n@l contact [@t 0.4] @in1 0.02 0.01 1",
    ),
}


@pytest.mark.parametrize(("name", "x0"), crossed([*JUMPS], [0.5, 0.02, -0.03]))
def test_model_input_initial_jump_drives_dampers(name: str, x0: float):
    """In the first step the model's input jumps from its x0 to the first value of its file."""
    dialect, links = JUMPS[name]
    mass = "@m mass 2 0.01 0.5" if dialect == "v2" else "@m mass 2 0.01 0.00999"
    ends = "@g ground 0\n@s spring @g @m 0.01\n@out1 posOutput @m\n"
    more = "@out2 posOutput [@t 0.4]\n" if "@t" in links else ""
    text = f"{mass}\n{ends}@in1 posInput {x0}\n{links}\n{more}"
    path, _ = path_and_push()
    path += np.float32(0.004)
    path = np.float64(np.float32(path))
    wave("path.wav", path)
    Path("m.mdl").write_text(text)
    for inputs, signal in (({}, {}), ({"in1": "path.wav"}, {"in1": path})):
        asked = ModelOptions(dialect=dialect, inputs=inputs)
        score = import_model("m.mdl", asked).text
        listened = mims.played(text, dialect, FRAMES / mims.RATE, inputs=signal)
        sound = rendered(score, FRAMES / mims.RATE)
        assert np.abs(sound - listened).max() <= 1e-11 * np.abs(listened).max(), score


def test_model_force_input_between_masses():
    _, push = path_and_push()
    wave("push.wav", push)
    text = "@in1 frcInput [@s 0.3]\n@s string 6 1 0.05 0.001 0 0\n@out1 posOutput [@s 0.7]\n"
    Path("m.mdl").write_text(text)
    listened = mims.played(text, "v2", FRAMES / mims.RATE, inputs={"in1": push})
    built = import_model("m.mdl", ModelOptions(dialect="v2", inputs={"in1": "push.wav"}))
    sound = rendered(built.text, FRAMES / mims.RATE)
    assert np.abs(sound - listened).max() <= 1e-12 * np.abs(listened).max()


def ramp(frame: int, value: float) -> np.ndarray:
    """From 0 to a value in 20 ms, from a frame on."""
    return value * np.clip((np.arange(FRAMES) + 1 - frame) / 882, 0.0, 1.0)


def later(signal: np.ndarray, by: int = 1) -> np.ndarray:
    return np.concatenate([np.zeros(by), signal[:-by]])


def test_model_osc_inputs_glide_to_target():
    """A position is reached at the end of its frame, so that it is heard a sample later."""
    message = HAND.replace("@m mass 1", "@p audioParam @in3\n@m mass [2+p]")
    Path("m.mdl").write_text(message)
    asked = ModelOptions(dialect="v2", inputs={"in1": "osc", "in2": "osc", "in3": "osc"})
    text = import_model("m.mdl", asked).text
    assert "in1: {input: osc, gain: 1m}  # /ergon/input/in1 VALUE, from -1 to 1" in text
    assert "in2: {input: osc, gain: 1N}" in text
    output = [(100, "in1", 0.01), (300, "in2", 1e-4), (2000, "in3", -0.5)]
    inputs = {
        "in1": later(ramp(100, 0.01)),
        "in2": ramp(300, 1e-4),
        "in3": later(ramp(2000, -0.5), 2),
    }
    listened = mims.played(message, "v2", FRAMES / mims.RATE, inputs=inputs)
    sound = rendered(text, FRAMES / mims.RATE, output)
    assert np.abs(listened).max() > 0.01
    assert np.abs(sound - listened).max() <= 1e-12 * np.abs(listened).max()


def test_import_refuses_unusable_input_files():
    path, _ = path_and_push()
    wave("slow.wav", path, 48_000)
    wave("two.wav", np.stack([path, path], axis=1))
    wave("late.wav", path + 0.5)
    Path("m.mdl").write_text(HAND)
    for name, message in {"slow": "48,000 Hz", "two": "2 channels", "none": "none.wav"}.items():
        with pytest.raises(OptionError, match=message):
            import_model("m.mdl", ModelOptions(dialect="v2", inputs={"in1": f"{name}.wav"}))
    with pytest.raises(OptionError, match=r"no input 'in3'.*in"):
        import_model("m.mdl", ModelOptions(dialect="v2", inputs={"in3": "late.wav"}))
    Path("folder").mkdir()
    with pytest.raises(OptionError, match="lies outside"):
        import_model("m.mdl", ModelOptions(inputs={"in1": "late.wav"}), beside="folder")


def test_import_command_options_and_refusals(capsys: pytest.CaptureFixture[str]):
    Path("m.mdl").write_text("@k param 0.01\n@m osc 1 k 0 [0 0 0.1] 0\n@out1 posOutput @m\n")
    assert app.run(["import", "m.mdl", "--set", "k=0.02", "--json"]) == 0
    assert records(capsys)[0]["dialect"] == "v2"
    assert "k: 0.02" in Path("m.yaml").read_text()
    assert app.run(["check", "m.yaml"]) == 0
    assert app.run(["import", "m.mdl", "-o", "m.mdl", "-f"]) != 0
    assert "osc" in Path("m.mdl").read_text()
    capsys.readouterr()
    before = Path("m.yaml").read_text()
    Path("m.mdl").write_text("@m sprong 1\n")
    assert app.run(["import", "m.mdl", "-f"]) == 2
    output = capsys.readouterr().err
    assert "m.mdl:1: 'sprong' is not a word" in output
    assert "Traceback" not in output
    assert Path("m.yaml").read_text() == before
    for words in (["--set", "k"], ["--feed", "in1=none.wav"], ["--set", "a=1", "--set", "a=2"]):
        assert app.run(["import", "m.mdl", "-f", *words]) == 2
        assert words[0] in capsys.readouterr().err
    assert app.run(["import", "none.mdl"]) == 2


def test_import_reports_unfed_inputs(capsys: pytest.CaptureFixture[str]):
    Path("m.mdl").write_text(HAND)
    assert app.run(["import", "m.mdl", "--dialect", "v2"]) == 0
    output = capsys.readouterr().err
    assert "in1, in2 stay at 0; --feed in1=FILE.wav feeds in1" in output
    wave("in1.wav", np.zeros(10))
    assert app.run(["import", "m.mdl", "--dialect", "v2", "-f", "--feed", "in1=in1.wav"]) == 0
    assert "in2 stays at 0; --feed in2=FILE.wav feeds in2" in capsys.readouterr().err


def test_import_of_texts_other_than_models_is_refused(capsys: pytest.CaptureFixture[str]):
    sentence = {
        "1 220.5 0.8 0.35\n2 440 0.5 0.4\n": "a table of resonances; `ergon bell m.txt` makes",
        "a letter to a friend\n": "a line begins with @ and a name",
        "": "no line begins with @ and a name",
        "faustcode: k=1.0;\naudioout,a0,0.0;\n": "it has no mass and no link",
    }
    for text, message in sentence.items():
        Path("m.txt").write_text(text)
        assert app.run(["import", "m.txt", "-o", "m.yaml", "-f"]) == 2
        output = capsys.readouterr().err
        assert message in output, output
        assert not Path("m.yaml").exists()


def test_import_refuses_setting_signal_parameter(tmp_path):
    path = tmp_path / "a.mdl"
    path.write_text("@p audioParam @in3\n@m mass 1 0 0\n@g ground 0\n@s spring @m @g 0.1\n")
    with pytest.raises(ModelError, match="'p' follows the signal of in3") as caught:
        import_model(path, ModelOptions(dialect="v2", values={"p": "3"}))
    assert "feed it by --feed in3=FILE.wav" in str(caught.value)
    assert caught.value.line == 1


@pytest.mark.parametrize(("name", "words"), [("p", "follows the signal"), ("q", "'q' is not a")])
def test_import_names_refused_value_without_dialect(tmp_path, name: str, words: str):
    """The other dialect reads no line of the model, which says nothing of the value."""
    path = tmp_path / "a.mdl"
    path.write_text(
        "@p audioParam @in3\n@m mass [sqrt(4) + 1] 0.5 0\n@g ground 0\n@s spring @m @g p\n"
    )
    with pytest.raises(ModelError, match=words):
        import_model(path, ModelOptions(values={name: "3"}))
