"""An edit of a text without its long runs of lines writes what an edit of the whole text writes."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.notation.text.elided import shorten
from ergon.scores.edits.texts import Texts

PATHS = st.sampled_from(
    [
        ("instruments", "links", "modules", "ref-1"),
        ("instruments", "links", "modules", "m3"),
        ("instruments", "bells", "modules", "m3"),
        ("instruments", "bells", "modules", "m99"),
        ("instruments", "bells", "out"),
        ("instruments", "new"),
        ("instruments", "bells"),
    ]
)


def score(n_modules: int, *, has_links: bool, is_commented: bool) -> str:
    remark = "      # a remark\n" if is_commented else ""
    modules = "".join(f"      m{n}: {{CEL: {{M: 2g, f: {200 + n}Hz}}}}\n" for n in range(n_modules))
    links = "".join(f"      m{n}: {{REF: {{K: {n}N/m}}}}\n" for n in range(9)) if has_links else ""
    return (
        f"ergon: 1\ninstruments:\n  bells:\n    modules:\n{modules}{remark}{modules.upper()}"
        "    out: {SOX: m0}\n"
        + (f"  links:\n    modules:\n{links}" if has_links else "")
        + "players: {ada: {key: k}}\n"
    )


@settings(max_examples=80)
@given(
    path=PATHS,
    n_modules=st.integers(1, 30),
    has_links=st.booleans(),
    is_commented=st.booleans(),
    is_removed=st.booleans(),
)
def test_elided_edit_equals_edit_of_complete_text(
    path, n_modules, has_links, is_commented, is_removed
):
    text = score(n_modules, has_links=has_links, is_commented=is_commented)
    texts, document = Texts("s.yaml", text), edit.read(text, "s.yaml")
    try:
        complete = (
            edit.remove(document, path) if is_removed else edit.put(document, path, "{REF: 1N/m}")
        )
    except EditError:
        with pytest.raises(EditError):
            _ = texts.remove(path) if is_removed else texts.put(path, "{REF: 1N/m}")
        return
    edited = texts.remove(path) if is_removed else texts.put(path, "{REF: 1N/m}")
    assert edited.text == complete


def test_elided_leaves_out_runs_but_keeps_named_lines():
    text = score(60, has_links=True, is_commented=False)
    short = shorten(text, {"instruments", "links", "modules", "m3"})
    assert short is not None
    assert short.text.count("\n") < 40
    assert "      m3: {CEL:" in short.text
    assert "      m14: " not in short.text
    assert short.restored(short.text) == text


@pytest.mark.parametrize(
    "text", ["a: {b: 1}\n", score(20, has_links=False, is_commented=False) + "x: &a 1\n"]
)
def test_elided_with_nothing_to_leave_out(text):
    assert shorten(text, ()) is None


def test_elided_with_a_changed_run_is_not_put_back():
    text = score(20, has_links=False, is_commented=False)
    short = shorten(text, ())
    assert short is not None
    assert short.restored(short.text.replace("elided-0", "other")) is None
