"""No function of the product is longer than what one screen or two show."""

from pathlib import Path

import pytest

from tests.house.test_names import FOLDERS, ROOT
from tests.support.function_lengths import function_lengths

LINES_MAX = 80
# Functions that are longer still, and by how many lines each may be. A number may only fall; a
# function that is not here has none.
LONGER = {
    ("core-rs/bridge/src/perform.rs", "new"): 98,
    ("core-rs/engine/src/island/build.rs", "new"): 103,
    ("core-rs/engine/src/island/coast.rs", "coast"): 82,
    ("core-rs/engine/src/island/fault.rs", "mute"): 97,
    ("core-rs/engine/src/island/fine/build.rs", "new"): 115,
    ("core-rs/engine/src/island/ledger.rs", "end_frame"): 142,
    ("core-rs/engine/src/kernel/runs.rs", "compute_link_forces"): 85,
    ("core-rs/engine/src/key_model/motion/derivatives.rs", "direct_terms"): 82,
    ("core-rs/engine/src/network/bodies.rs", "add_mesh"): 90,
    ("core-rs/engine/src/network/modes.rs", "part_modes"): 82,
    ("core-rs/engine/src/assembly/assemble.rs", "new"): 85,
    ("core-rs/engine/src/body_modes/complex_modes/blocks.rs", "add"): 117,
    ("core-rs/engine/src/assembly/islands.rs", "islands"): 88,
    ("core-rs/engine/src/assembly/slow.rs", "find_bodies"): 107,
    ("core-rs/engine/src/assembly/split.rs", "split"): 92,
    ("core-rs/engine/src/spectrum/general/schur.rs", "sweep"): 87,
    ("core-rs/engine/src/start.rs", "forces"): 101,
    ("core-rs/live/src/perform/prepare.rs", "prepare"): 144,
    ("core-rs/live/src/safety/plausibility/playing_hands.rs", "play_cases"): 108,
    ("core-rs/engine/src/plan/make.rs", "plan_stepped"): 97,
}


def is_product(path: Path) -> bool:
    parts = path.relative_to(ROOT).parts
    is_test = "tests" in parts or path.stem in ("tests", "test")
    return not (is_test or "target" in parts or path.is_symlink())


def longer_functions() -> dict[tuple[str, str], int]:
    every = [path for name in FOLDERS for path in (ROOT / name).rglob("*.[pr][ys]")]
    return {
        (str(path.relative_to(ROOT)), function.name): function.lines
        for path in filter(is_product, every)
        for function in function_lengths(path)
        if function.lines > LINES_MAX
    }


def test_function_lengths_of_product():
    assert longer_functions() == LONGER


@pytest.mark.parametrize(
    ("name", "text", "length"),
    [
        ("a.py", "def long():\n" + "    x = 1\n" * 90, 91),
        ("a.py", "class A:\n    async def long(self):\n" + "        x = 1\n" * 80, 81),
        ("a.rs", "impl A {\n    fn long() {\n" + "        one();\n" * 90 + "    }\n}\n", 92),
        ("a.rs", "fn short() {\n    fn long() {\n" + "        one();\n" * 3 + "    }\n}\n", 5),
    ],
)
def test_function_lengths_in_text(tmp_path: Path, name: str, text: str, length: int):
    path = tmp_path / name
    path.write_text(text)
    assert ("long", length) in [(item.name, item.lines) for item in function_lengths(path)]
