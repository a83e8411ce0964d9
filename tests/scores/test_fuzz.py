"""No text raises: whatever is written, a score is answered by diagnostics."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep import few

from ergon.notation.text.errors import full
from ergon.scores.reading.load import load

DATA = Path(__file__).parents[1] / "data"
DUET = (DATA / "duet-2.2.yaml").read_text(encoding="utf-8")
MELODIES = (DATA / "melodies.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("score_text", few([DUET, MELODIES], 1), ids=["duet", "melodies"])
@settings(max_examples=200)
@given(st.data())
def test_load_of_damaged_scores_never_raises(score_text, data):
    """Cut, double or replace a stretch of a score: diagnostics, never an exception."""
    start = data.draw(st.integers(0, len(score_text)))
    stop = data.draw(st.integers(start, min(len(score_text), start + 30)))
    new = data.draw(st.text(":{}[]-|,.0123456789@ \nabM\t'#&*!é", max_size=6))
    loaded = load(DATA / "duet-2.2.yaml", text=score_text[:start] + new + score_text[stop:])
    for d in loaded.diagnostics:
        assert full(d, loaded.files)
    assert (loaded.piece is None) == any(d.severity == "error" for d in loaded.diagnostics)


@settings(max_examples=200)
@given(st.text(max_size=60))
def test_load_of_random_text_never_raises(text):
    load("s.yaml", text=text)


WORDS = (
    "M K Z f t60 like use from modules CEL REF LNL between to at out SOX SOF a b a.b 1g 1|1 A3 "
    "keys gestures notation points parts players play every do duet couple mix route "
    "transpose 7st x1.5 notes C3..C5 members entries what phrases velocity depth 1mNs t.mid a.A3"
)
SECTIONS = (
    "use rates tempo marks keys instruments laws gestures phrases takes strikes players duet parts "
    "mix render accuracy"
)
_WORDS = st.sampled_from(WORDS.split())
_TREES = st.recursive(
    _WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_WORDS, inner, max_size=4),
    max_leaves=12,
)


def written(tree):
    if isinstance(tree, dict):
        return "{" + ", ".join(f"{key}: {written(value)}" for key, value in tree.items()) + "}"
    if isinstance(tree, list):
        return "[" + ", ".join(map(written, tree)) + "]"
    return f"'{tree}'"


@settings(max_examples=400)
@given(
    st.dictionaries(
        st.sampled_from(SECTIONS.split()),
        st.dictionaries(st.sampled_from(["a", "b", "p"]), _TREES, max_size=2) | _TREES,
        max_size=5,
    )
)
def test_load_of_random_trees_never_raises(tree):
    load("s.yaml", text=written(tree))
