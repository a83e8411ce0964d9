"""Models of both dialects as scores, beside an interpreter of their language: sample for sample."""

import numpy as np
import pytest
from imported import rendered
from oracle import mims
from planned_sound import off_db
from sweep import few

from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.grammar import FORMS
from ergon.workshop.models.mims.reading import parse
from ergon.workshop.models.mims.score import score_text

SECONDS = 0.1
LINEAR, TOUCHING = 1e-12, 1e-5  # largest error: where rounding does not grow, and where it may

# Name: dialect, text. A model under `touching` has contacts or laws by which rounding grows.
V2 = {
    "mass": "@g ground 0.2\n@m mass 2.5 0.1 10\n@s spring @g @m 0.01\n@out1 posOutput @m",
    "mass with gravity": """
@g ground 0
@m mass 2 0.3 0.1 0.
@s springDamper @g @m 0.01 0.002
@out1 posOutput @m""",
    "gravity of a sum": """
@a param 0.0001
@b param 2
@g ground 0
@m mass 2 [a + b] 0.1 0.
@s spring @m @g 0.001
@out1 posOutput @m""",
    "osc": "@m osc 1.5 0.02 0.001 0.1 -3\n@out1 posOutput @m",
    "osc with gravity": "@m osc 1.5 0.02 0.001 5 0.1 -3\n@out1 posOutput @m",
    "three coordinates": "@m osc 1 0.02 0 [3 2 0.5] [0 0 1]\n@out1 posOutput @m",
    "buffers and prose": """
A model of a mass; this is no statement.
~begin all
@m osc 1 0.02 0 0.5 1
~end all
@out1 posOutput @m""",
    "parameters": """
@kScale param 0.01
@M param 3
@m osc [2*M] [0.01 + 0.5*kScale] kScale 0.1 0
@out1 posOutput @m""",
    "a root": "@k param 0.02\n@m osc 2 [sqrt(k*0.01)] [0.1*sqrt(0.0004)] 0.1 0\n@out1 posOutput @m",
    "parameter behind its use": "@m osc M 0.01 0 0.1 0\n@M param 3\n@out1 posOutput @m",
    "names that a score has otherwise": """
@N param 2
@g param 0.01
@_m osc N g 0 0.1 0
@out1 posOutput @_m""",
    "damper": "@g ground 0\n@m mass 2 0.1 50\n@d damper @g @m 0.01\n@out1 posOutput @m",
    "spring chain by hand": """
@g ground 0
@a mass 1 0.1 0
@b mass 1 0 0
@s1 spring @g @a 0.1
@s2 springDamper @a @b 0.05 0.001
@out1 posOutput @a
@out2 posOutput @b""",
    "string": """
@s string 12 1 0.05 0.0005 0 0
@m mass 1 0.1 0
@l springDamper @m [@s 1] 0.01 0
@l2 spring @m [@s 0] 0.01
@d mass 3 0.2 0
@e spring @d [@s 0.45454545454545453] 0.002
@out1 posOutput [@s 0.45454545454545453]
@out2 posOutput @m""",
    "string elsewhere, with air": """
@k param 0.05
@s string 9 2 k 0.0005 0.0001 0.5 0
@m mass 1 0.1 0
@l spring @m [@s 0.25] 0.01
@l2 spring @m [@s 0] 0.01
@out1 posOutput [@s 0.5]
@out2 posOutput [@s 1]""",
    "string of three points": """
@s string 3 1 0.05 0.0005 0.0001 0 0
@m mass 1 0.1 0
@l spring @m [@s 0.5] 0.01
@out1 posOutput [@s 0.5]""",
    "string of three points elsewhere": """
@s string 3 1 0.05 0.0005 0.0001 0.1 0
@m mass 1 0.2 0
@l spring @m [@s 0.5] 0.01
@out1 posOutput [@s 0.5]""",
    "chain": """
@c chain 8 1 0.05 0.0005 0.2 -10
@g ground 0
@l spring @g [@c 0] 0.01
@out1 posOutput [@c 1]""",
    "chain in air": """
@c chain 8 [1 + 1] 0.05 0.0005 0.001 0.2 -10
@g ground 0
@l spring @g [@c 0] 0.01
@out1 posOutput [@c 1]""",
    "chain of one": "@c chain 1 2 0.05 0 0.001 0.2 -10\n@out1 posOutput [@c 0]",
    "chain of two": """
@c chain 2 2 0.05 0 0.001 0.2 -10
@g ground 0
@l spring @g [@c 0] 0.01
@out1 posOutput [@c 1]""",
    "stiffString": """
@s stiffString 12 1 0.05 0.01 0.0005 0 0
@m mass 1 0.1 0
@l spring @m [@s 0.18181818181818182] 0.01
@out1 posOutput [@s 0.18181818181818182]""",
    "short stiffString": """
@s stiffString 4 1 0.05 0.01 0.0005 0.0001 0 0
@m mass 1 0.1 0
@l spring @m [@s 0.33333333333333331] 0.01
@out1 posOutput [@s 0.66666666666666663]""",
    "shortest stiffString": """
@s stiffString 3 1 0.05 0.01 0.0005 0 0
@m mass 1 0.1 0
@l spring @m [@s 0.5] 0.01
@out1 posOutput [@s 0.5]""",
    "stiffString elsewhere": """
@s stiffString 7 1 0.05 0.01 0.0005 0.3 0
@m mass 1 0.1 0
@l spring @m [@s 0.5] 0.01
@out1 posOutput [@s 0.16666666666666666]""",
    "mesh": """
@m mesh 4 6 1 0.05 0.0005 0 0
@a mass 1 0.1 0
@l spring @a [@m 1 0.2] 0.01
@g ground 0
@h spring @g [@m 0 0] 0.002
@out1 posOutput [@m 1 0.2]
@out2 posOutput [@m 0.33333333333333331 1]""",
    "mesh in air": """
@m mesh 3 3 1 0.05 0.0005 0.001 0.2 -5
@g ground 0
@h spring @g [@m 0 0] 0.002
@out1 posOutput [@m 0.5 1]""",
    "mesh of one row": """
@m mesh 1 5 1 0.05 0.0005 0.2 -5
@g ground 0
@h spring @g [@m 0 0] 0.002
@out1 posOutput [@m 0 1]""",
    "closedMesh": """
@m closedMesh 5 6 1 0.05 0.0005 0.0002 0 2
@a mass 1 0.1 0
@l spring @a [@m 0.5 0.2] 0.01
@h spring @a [@m 0 0.2] 0.01
@out1 posOutput [@m 0.75 0.6]
@out2 posOutput @a""",
    "closedMesh elsewhere": """
@m closedMesh 5 4 1 0.05 0.0005 0.0002 0.3 2
@a mass 1 0.1 0
@l spring @a [@m 0.5 0.33333333333333331] 0.01
@out1 posOutput [@m 0.75 0.66666666666666663]
@out2 posOutput [@m 0 0]""",
    "smallest closedMesh": """
@m closedMesh 3 3 1 0.05 0.0005 0.1 2
@out1 posOutput [@m 0.5 0.5]""",
    "cornerMesh": """
@m cornerMesh 4 5 1 0.05 0.0005 0 2
@a mass 1 0.1 0
@l spring @a [@m 0 0.25] 0.01
@h spring @a [@m 1 1] 0.01
@out1 posOutput [@m 1 0.5]
@out2 posOutput [@m 0 1]""",
    "cornerMesh elsewhere, in air": """
@m cornerMesh 3 3 1 0.05 0.0005 0.0003 0.2 2
@out1 posOutput [@m 0.5 0.5]
@out2 posOutput [@m 0 0.5]""",
    "force on a mass": """
@g ground 0
@a mass 1 0.1 0
@b mass 1 0 0
@s1 spring @g @a 0.1
@s2 springDamper @a @b 0.05 0.001
@out1 frcOutput @a
@out3 posOutput @b""",
    "force on a first end": """
@g ground 0
@a mass 1 0.1 0
@s1 spring @a @g 0.1
@out1 frcOutput @a""",
}
V2 |= {
    "between masses of a string": """
@k param 0.02
@s string 6 1 0.05 0.0005 0 0
@a mass 1 0.1 0
@b mass 3 0.05 0
@l springDamper @a [@s 0.33] k 0.001
@l2 spring [@s 0.9] @b k
@d damper @b [@s 0.5] 0.002
@out1 posOutput [@s 0.25]
@out2 posOutput @b""",
    "between points of one string": """
@s chain 6 1 0.05 0.0005 0.1 4
@g ground 0
@h spring @g [@s 0.1] 0.01
@l spring [@s 0.3] [@s 0.35] 0.01
@out1 posOutput [@s 0.77]""",
    "between masses of meshes": """
@p mesh 3 4 1 0.05 0.0005 0 0
@q closedMesh 4 4 1 0.05 0.0005 0 3
@l springDamper [@p 0.3 0.8] [@q 0.1 0.45] 0.03 0.002
@out1 posOutput [@p 0.1 0.6]
@out2 posOutput [@q 0.9 0.5]""",
    "force of a link that ends between masses": """
@s string 6 1 0.05 0.0005 0 0
@a mass 1 0.1 0
@l springDamper @a [@s 0.33] 0.02 0.001
@out1 frcOutput @a
@out2 posOutput [@s 0.6]""",
    "clamped places": """
@s chain 6 1 0.05 0.0005 0.1 4
@g ground 0
@h spring @g [@s 1.7] 0.01
@out1 posOutput [@s 0-0.3]
@out2 posOutput [@s 1.2]""",
}
V2_TOUCHING = {
    "contact": """
@g ground 0
@a mass 1 -0.1 100
@c contact @a @g 0.1 0.01
@s spring @a @g 0.001
@out1 posOutput @a""",
    "contact with a threshold": """
@g ground 0
@t param 0.05
@a mass 1 -0.1 100
@c contact @a @g 0.1 0.01 t
@s spring @a @g 0.001
@out1 posOutput @a
@out2 frcOutput @g""",
    "force of a contact at its first end": """
@g ground 0
@a mass 1 -0.1 400
@c contact @a @g 0.1 0.01
@out1 frcOutput @a
@out2 posOutput @a""",
    "nlContact": """
@g ground 0
@a mass 1 -0.1 400
@c nlContact @a @g 0.1 20 0.3 0.01 0.02
@s spring @a @g 0.001
@out1 posOutput @a""",
    "nlContact beyond its limit": """
@g ground 0
@a mass 1 -0.1 4000
@c nlContact @a @g 0.1 200 0.3 0.01
@out1 posOutput @a""",
    "nlContact without a cubic part": """
@g ground 0
@a mass 1 -0.1 400
@c nlContact @a @g 0.1 0 0.3 0.01
@out1 posOutput @a""",
    "nlContact with a limit below K": """
@g ground 0
@a mass 1 -0.1 400
@c nlContact @a @g 0.1 10 0.03 0.01
@out1 posOutput @a""",
    "nlSpring2": """
@g ground 0
@a mass 1 0.3 0
@c nlSpring2 @a @g 0.01 0.1 0.001
@out1 posOutput @a""",
    "nlSpring3": """
@g ground 0
@a mass 1 0.3 0
@c nlSpring3 @a @g 0.01 0.5 0.001
@out1 posOutput @a""",
    "nlSpringDamper": """
@g ground 0
@a mass 1 0.3 0
@c nlSpringDamper @a @g 0.01 0.5 0.03 0.0001
@out1 posOutput @a""",
    "nlSpringDamper without a cubic part": """
@g ground 0
@a mass 1 0.3 0
@c nlSpringDamper @a @g 0.01 0 0.03 0.0001
@out1 posOutput @a""",
    "nlSpringDamper with a limit below K": """
@g ground 0
@a mass 1 0.3 0
@c nlSpringDamper @a @g 0.04 0.5 0.03 0.0001
@out1 posOutput @a""",
    "nlPluck": """
@a osc 1 0.01 0.001 0.02 0
@b mass 1 -0.05 30
@c nlPluck @b @a 0.05 0.04
@out1 posOutput @a
@out2 posOutput @b""",
    "nlPluck with Z": """
@a osc 1 0.01 0.001 0.02 0
@b mass 1 -0.05 30
@c nlPluck @b @a 0.05 0.04 0.01
@out1 posOutput @a""",
    "nlBow": """
@a osc 1 0.01 0.0001 0 0
@b mass 1000 0 20
@c nlBow @b @a 0.03 0.001
@out1 posOutput @a""",
    "smooth nlBow": """
@a osc 1 0.01 0.0001 0 0
@b mass 1000 0 20
@c nlBow @b @a 0.03 0.001 1
@out1 posOutput @a""",
    "a string that is plucked": """
@s string 12 1 0.05 0.0005 0 0
@b mass 1 -0.05 30
@c nlPluck @b [@s 0.27272727272727271] 0.05 0.04
@out1 posOutput [@s 0.27272727272727271]""",
}
V1 = {
    "mass at rest": """
@g ground 0
@m mass 10 1. 1.  # at rest
@s spring @g @m 0.1
@out1 posOutput @m""",
    "mass that moves": "@g ground 0\n@m mass 10 1. 0.99\n@s spring @g @m 0.1\n@out1 posOutput @m",
    "mass shown": """
@g ground 0 all 1 2
@m mass 10 1. 0.99 all 3 4
@s spring @g @m 0.1
@out1 posOutput @m""",
    "massG": "@g ground 0\n@m massG 10 0.0001 1. 1.\n@s spring @g @m 0.1\n@out1 posOutput @m",
    "osc": "@m osc 10 0.1 0.001 1. 0.99\n@out1 posOutput @m",
    "position of a parameter": "@p param 0.5\n@m osc 10 0.1 0.001 p p\n@out1 posOutput @m",
    "spring with viscosity": """
@g ground 0
@m mass 10 1 1
@s spring @g @m 0.1 0.01
@out1 posOutput @m""",
    "links of one name": """
@g ground 0
@m mass 10 1 1
@s spring @g @m 0.1
@s damper @g @m 0.01
@out1 posOutput @m""",
    "damper and springDamper": """
@g ground 0
@m mass 10 1 1
@n mass 10 0 0
@s springDamper @g @m 0.1 0.002
@d damper @m @n 0.01
@out1 posOutput @m
@out2 frcOutput @n""",
    "string": """
@s string 11 1 0.05 0.0005 0
@m mass 1 0.1 0.1
@l spring @m @s 0.01 0.3
@out1 posOutput @s 0.5""",
    "two macros joined": """
@s string 11 1 0.05 0.0005 0
@c chain 5 1 0.05 0.0005 0
@m mass 1 0.1 0.1
@l spring @m @s 0.01 0.3
@j springDamper @s @c 0.02 0.001 0.7 0.25
@out1 posOutput @c 1""",
    "stiffString": """
@s stiffString 11 1 0.05 0.01 0.0005 0
@m mass 1 0.1 0.1
@l spring @m @s 0.01 0.3
@out1 posOutput @s 0.9""",
    "meshes": """
@a mesh 3 5 1 0.05 0.0005 0
@b closedMesh 5 5 1 0.05 0.0005 0
@c cornerMesh 3 3 1 0.05 0.0005 0
@m mass 1 0.1 0.1
@l1 spring @m @a 0.01 0.5:0.25
@l2 spring @m @b 0.01 0.5:0.25
@l3 spring @b @c 0.01 0.5:0.5 0:0.5
@out1 posOutput @a 1:1
@out2 posOutput @b 0.75:0.75
@out3 posOutput @c 1:0.5""",
}
V1_TOUCHING = {
    "detent": """
@g ground 0
@a mass 1 -0.1 -0.099
@d detent @g @a 0.1 0.01 0.02
@s spring @a @g 0.001
@out1 posOutput @a""",
    "contact": """
@g ground 0
@a mass 1 -0.1 -0.099
@c contact @g @a 0.1 0.01 0.
@s spring @a @g 0.001
@out1 posOutput @a""",
    "nlSpring": """
@g ground 0
@a mass 1 0.3 0.3
@c nlSpring @a @g 0.01 0.1 0.001
@out1 posOutput @a""",
    "nlSpring2": """
@g ground 0
@a mass 1 0.3 0.3
@c nlSpring2 @a @g 0.01 0.1 0.001
@out1 posOutput @a""",
    "nlSpring3 twice": """
@g ground 0
@k param 0.01
@a mass 1 0.3 0.3
@c nlSpring3 @a @g k 0.5 0.001
@out1 posOutput @a""",
    "nlPluck": """
@a osc 1 0.01 0.001 0.02 0.02
@b mass 1 -0.05 -0.051
@c nlPluck @b @a 0.05 0.04
@out1 posOutput @a""",
    "nlBow": """
@a osc 1 0.01 0.0001 0 0
@b mass 1000 0 -0.0005
@c nlBow @b @a 0.03 0.001
@out1 posOutput @a""",
    "contact with a threshold": """
@g ground 0
@a mass 1 -0.1 -0.105
@c contact @a @g 0.05 0.01 0.02
@s spring @a @g 0.001
@out1 posOutput @a""",
}
MODELS = {"v1": (V1, V1_TOUCHING), "v2": (V2, V2_TOUCHING)}
CASES = [
    pytest.param(dialect, text, bound, id=f"{dialect} {name}")
    for dialect, sets in MODELS.items()
    for models, bound in zip(sets, (LINEAR, TOUCHING), strict=True)
    for name, text in models.items()
]
OLD = ("nlPluck", "nlBow", "contact", "contact with a threshold", "string", "stiffString")


def test_model_cases_number_at_least_sixty():
    assert len(CASES) >= 60


def sounds_alike(dialect: str, text: str, bound: float, seconds: float) -> None:
    listened = mims.played(text, dialect, seconds)
    assert np.abs(listened).max() > 1e-6, "the model is silent"
    sound = rendered(score_text(parse(text, dialect)), seconds)
    sizes = np.abs(listened).max(axis=0)
    off = np.abs(sound - listened).max(axis=0)
    assert np.all(off <= bound * sizes.max()), f"{20 * np.log10(off.max() / sizes.max()):.1f} dB"


@pytest.mark.parametrize(("dialect", "text", "bound"), few(CASES, CASES[::3]))
def test_imported_model_equals_interpreter(dialect: str, text: str, bound: float):
    sounds_alike(dialect, text, bound, SECONDS)


@pytest.mark.slow
@pytest.mark.parametrize(("dialect", "text", "bound"), CASES)
def test_imported_model_equals_interpreter_one_second(dialect: str, text: str, bound: float):
    sounds_alike(dialect, text, bound, 1.0)


@pytest.mark.parametrize("name", OLD)
def test_v1_laws_differ_from_v2(name: str):
    text = {**V1, **V1_TOUCHING}[name]
    if name in ("string", "stiffString"):  # points lie at a·N
        text = text.replace(" 0.3\n", " 0.2727272727272727\n").replace(
            "@s 0.5", "@s 0.54545454545454541"
        )
        text = text.replace(" 0.9", " 0.81818181818181823")
    then = mims.played(text, "v1", SECONDS, laws="2019")
    now = mims.played(text, "v1", SECONDS)
    if name != "contact":
        assert np.abs(then - now).max() > 1e-6 * np.abs(now).max(), "both laws are the same here"
    sound = rendered(score_text(parse(text, "v1"), "2019"), SECONDS)
    assert off_db(sound, then) < -100.0


def test_model_cases_cover_all_words():
    tried = {
        dialect: "\n".join((*a.values(), *b.values())).split() for dialect, (a, b) in MODELS.items()
    }
    others = {"param", "audioParam", "posInput", "frcInput"}  # tests/models/test_refused.py, inputs
    for dialect, forms in FORMS.items():
        assert set(forms) - others <= set(tried[dialect])


def test_model_parameter_override():
    text = V2["parameters"]
    sound = rendered(score_text(parse(text, "v2", overrides={"kScale": "0.03"})), SECONDS)
    listened = mims.played(text, "v2", SECONDS, arguments={"kScale": 0.03})
    assert np.abs(sound - listened).max() < LINEAR
    with pytest.raises(ModelError, match=r"'kscale' is not a parameter.*kScale"):
        parse(text, "v2", overrides={"kscale": "1"})
