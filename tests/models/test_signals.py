"""Parameters of models that follow signals: K, Z, M and the values of laws, sample for sample."""

from pathlib import Path

import numpy as np
import pytest
import soundfile
from checked import check
from imported import rendered
from oracle import mims
from sweep import crossed

from ergon.workshop.api.model import ModelOptions, import_model
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.reading import parse
from ergon.workshop.models.mims.score import score_text

FRAMES = 1500
pytestmark = pytest.mark.usefixtures("work_folder")
T = np.arange(FRAMES + 2) / mims.RATE
SIGNALS = {
    "in1": 0.05 + 0.04 * np.sin(2 * np.pi * 170 * T + 0.3),
    "in2": 0.004 + 0.003 * np.cos(2 * np.pi * 410 * T),
    "in3": np.where(T * 900 % 1 < 0.5, 2.0, 0.75),  # jumps
}
HEAD = "@x audioParam @in1\n@y audioParam @in2\n@w audioParam @in3\n@g ground 0\n"
HAND = f"{HEAD}@h mass 9 0.03 -20\n@r springDamper @g @h 0.02 0.001\n@m mass 1 0.01 30\n"
STRING = f"{HEAD}@h mass 9 0.03 -20\n@r springDamper @g @h 0.02 0.001\n"
OUT = "\n@out1 posOutput @m\n@out2 posOutput @h\n"

LINKS = {
    "spring": "spring @m @h x",
    "damper": "damper @h @m y\n@k spring @m @h 0.02",
    "springDamper": "springDamper @m @h x y",
    "one of two": "springDamper @m @h [0.01 + 2*x] 0.002",
    "contact": "contact @m @h x y 0.01",
    "contact from the other side": "contact @h @m 0.05 y",
    "nlSpring2": "nlSpring2 @m @h x w [0.1*y]",
    "nlSpring3": "nlSpring3 @m @h 0.01 [100*x] 0.001",
    "Z of nlContact": "nlContact @m @h 0.01 5 0.2 y",
    "Z of nlSpringDamper": "nlSpringDamper @m @h 0.01 20 0.2 y",
    "K of nlContact": "nlContact @m @h x 20 0.04 y",
    "Q and lim of nlContact": "nlContact @m @h 0.03 [100*w] x 0.001 0.005",
    "thresh of a contact": "contact @m @h 0.05 0.002 [4*y]",
    "thresh of nlContact": "nlContact @h @m 0.01 50 0.2 0.002 [4*y]",
    "four of nlContact": "nlContact @m @h x [100*w] [2*x] 0.003 [4*y]",
    "K of nlSpringDamper": "nlSpringDamper @m @h x 20 0.05 0.002",
    "Q of nlSpringDamper that goes": "nlSpringDamper @m @h 0.01 [100*w - 75] 0.03 y",
    "lim of nlSpringDamper": "nlSpringDamper @h @m 0.05 20 x 0.001",
    "lim of nlSpringDamper without Q": "nlSpringDamper @h @m 0.05 0 x 0.001",
    "bow": "nlBow @m @h x [0.002 + 0.004*x]",
    "scale of a bow": "nlBow @m @h 0.05 [0.01*w]",
    "smooth bow": "nlBow @m @h x y 1",
    "pluck": "nlPluck @m @h x [0.05*w]",
    "damped pluck": "nlPluck @m @h 0.03 0.06 y",
}
MASSES = {
    "K and Z of an osc": "@m osc 1 x y 0.01 30",
    "M of an osc": "@m osc w 0.05 0.002 0.01 30",
    "all of an osc": "@m osc [1 + w] x y 0.002 0.01 -20",
    "M of a mass": "@m mass w 0.01 30\n@k springDamper @m @h 0.03 0.002",
    "M of a mass that falls": "@m mass [3 - w] 0.001 0.01 30\n@k spring @m @g 0.03",
}
BODIES = {
    "K of a chain": "@s chain 9 1 x 0.002 0.0001 0.01 30",
    "Z of a chain": "@s chain 7 2 0.05 y 0.02 30",
    "K and Z of a string": "@s string 8 1 x y 0 0",
    "a string of one mass": "@s string 3 1 x y 0 0",
    "a string elsewhere": "@s string 6 1 x 0.001 0.02 0",
}


def compared(text: str, laws: str = "head", least: float = 1e-12) -> None:
    """A model and its score, to the last bits of rounding."""
    signals = {name: np.float64(np.float32(signal)) for name, signal in SIGNALS.items()}
    for name, signal in signals.items():
        soundfile.write(f"{name}.wav", signal, mims.RATE, subtype="FLOAT")
    Path("m.mdl").write_text(text)
    known = [name for name in signals if f"@{name}" in text]
    files = {name: f"{name}.wav" for name in known}
    built = import_model("m.mdl", ModelOptions(dialect="v2", laws=laws, inputs=files))
    check(built.text)
    listened = mims.played(text, "v2", FRAMES / mims.RATE, laws, inputs=signals)
    sound = rendered(built.text, FRAMES / mims.RATE)
    assert np.abs(listened[:, 0]).max() > 1e-6
    assert np.abs(sound - listened).max() <= least * np.abs(listened).max(), built.text


@pytest.mark.parametrize(("name", "laws"), crossed([*LINKS], ["head", "2019"]))
def test_signal_as_link_parameter(name: str, laws: str):
    compared(f"{HAND}@l {LINKS[name]}{OUT}", laws)


@pytest.mark.parametrize("name", MASSES)
def test_signal_as_mass_parameter(name: str):
    """A mass takes the value of the step that it goes, a link that of where it is."""
    compared(f"{STRING}{MASSES[name]}{OUT}")


@pytest.mark.parametrize("name", BODIES)
def test_signal_as_string_or_mesh_parameter(name: str):
    lines = "@l springDamper [@s 0.4] @h 0.02 0.001\n@out1 posOutput [@s 0.3]\n"
    compared(f"{STRING}{BODIES[name]}\n{lines}@out2 posOutput @h\n")


def test_signal_as_bow_force_between_masses():
    lines = "@s string 9 1 0.3 0.002 0 0\n@b nlBow [@s 0.33] @h x [0.002 + 0.004*x]\n"
    compared(f"{STRING}{lines}@out1 posOutput [@s 0.6]\n@out2 posOutput @h\n")


def test_signal_with_initial_jump_of_input():
    """What is felt of the first step is by the first values of the signals."""
    text = f"{HAND}@in4 posInput 0.5\n@l springDamper @in4 @m x y{OUT}"
    compared(text)


@pytest.mark.parametrize("kind", ["string 7 1 0.1 0.01 0 50", "stiffString 8 1 0.1 0.02 0.01 0 9"])
def test_signal_parameter_string_end_forces(kind: str):
    compared(f"@s {kind}\n@out1 posOutput [@s 0.3]\n")


def test_signal_parameter_string_of_one_mass():
    compared("@s string 3 1 0.1 0.01 0.02 50\n@out1 posOutput [@s 0.5]\n")


def test_signal_without_file_becomes_constant():
    text = f"{HAND}@l springDamper @m @h [0.02 + x] [0.001 + y]{OUT}"
    built = score_text(parse(text, "v2"))
    assert "follows" not in built
    assert "K: 0.02, Z: 0.001" in built


REFUSED = {
    "a mass": (5, f"{HEAD}@m mass x 0 0", "M is 0 in the first sample"),
    "smooth": (8, f"{HAND}@l nlBow @m @h 1 0.1 x{OUT}", "which smooth of this word cannot do"),
    "five": (8, f"{HAND}@l nlContact @m @h x w w y x{OUT}", "5 values follow signals"),
    "a lim below 0": (8, f"{HAND}@l nlContact @m @h 0 1 [x - 1] 0{OUT}", "lim is -0.9"),
    "a gain of two": (8, f"{HAND}@l spring @m @h [x*y]{OUT}", "follows two signals"),
    "a curve": (8, f"{HAND}@l spring @m @h [x*x]{OUT}", "not a straight line"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_signal_mistakes_refused_with_line(name: str):
    line, text, message = REFUSED[name]
    signals = {name: np.float32(signal) for name, signal in SIGNALS.items()}
    for each, signal in signals.items():
        soundfile.write(f"{each}.wav", signal, mims.RATE, subtype="FLOAT")
    Path("m.mdl").write_text(text)
    files = {each: f"{each}.wav" for each in signals} if name != "a mass" else {}
    with pytest.raises(ModelError, match=message) as raised:
        import_model("m.mdl", ModelOptions(dialect="v2", inputs=files))
    assert raised.value.line == line
