"""What a prompt offers of a line: what could follow, colours, help."""

import re

import pytest
from spoken import OTHERS, ROOT, SCOPE, SESSION

from ergon.repl.language import help, verbs
from ergon.repl.language.complete import complete
from ergon.repl.language.highlight import highlighted_tokens
from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal


def offered(line: str, cursor: int | None = None) -> list[str]:
    return [s.text for s in complete(line, len(line) if cursor is None else cursor, SCOPE)]


@pytest.mark.parametrize(
    ("line", "some"),
    [
        ("", {"ada", "remi", "tempo", "knock"}),
        ("te", {"tempo"}),
        ("ada ", {"plays", "do"}),
        ("ada plays ", {"knock", "solo"}),
        ("ada plays knock ", {"every", "scale", "now", "at"}),
        ("ada plays knock until ", {"A", "B"}),
        ("ada plays knock touch ", {"open", "tracked"}),
        ("ada plays knock every 2", {"2bar", "2ms"}),
        ("ada do mirror, sc", {"scale"}),
        ("set ", {"bell.", "k1."}),
        ("set bell.m.", {"bell.m.K"}),
        ("set bell.m.K 9", {"9N/m", "9kN/m"}),
        ("set bell.m.K 900N/m ", {"over", "now"}),
        ("couple k1 k2 K=4", {"K=4N/m"}),
        ("knock = 0@0 sm", {"smooth"}),
        ("knock = 6", {"6mm@"}),
        ("tempo 60 ", {"->", "now"}),
        ("stop at ", {"A", "B", "C"}),
        ("record ", {"remi", "off"}),
        ("gain ", {"bell", "ada", "-6dB"}),
        ("?l", {"lean"}),
        ("? bell.", {"bell.m."}),
        ("help t", {"tempo", "tap"}),
        ("play\nada pl", {"plays"}),
        ("ada plays knock \\\n ev", {"every"}),
    ],
)
def test_complete_offers_expected_words(line: str, some: set[str]):
    result = complete(line, len(line), SCOPE)
    assert some <= {s.text for s in result}
    for suggestion in result:
        assert suggestion.hint
        assert "\n" not in suggestion.hint
        assert suggestion.text.lower().startswith(line[suggestion.start :].lower())


def test_complete_offers_no_refused_words():
    assert offered("ada plays knock every n") == []  # `now` is no length
    assert offered("ada plays knock # ") == []
    assert offered("xyz ") == []
    assert "over" not in offered("stop ")


UNFINISHED = re.compile(
    "missing|wants|needs|has no point after it|plays or does|K or "
    "Z|ramp|is not a tempo|another number of values"
)


@pytest.mark.parametrize("line", [line.split(" #")[0] for line, _ in SESSION + OTHERS])
def test_complete_offers_only_valid_or_unfinished_lines(line: str):
    for cut in [i for i, character in enumerate(line) if character == " "]:
        head = line[: cut + 1]
        for suggestion in complete(head, len(head), SCOPE):
            text = head[: suggestion.start] + suggestion.text
            if suggestion.text[-1] not in ".@/":  # `bell.`, `6mm@`, `skins/` go on
                assert UNFINISHED.search(sentence(text)), text


def sentence(text: str) -> str:
    """Why a text is refused; for one that is taken, that nothing is missing."""
    try:
        parse(text, SCOPE)
    except Refusal as refusal:
        return refusal.message
    return "nothing is missing"


def test_completion_uses_words_up_to_cursor():
    assert offered("ada pl knock every 1", 6) == ["plays"]


def test_colours_of_a_line():
    line = "ada plays knock every 1/2 until Q # why"
    assert [(line[a:b], kind) for a, b, kind in highlighted_tokens(line, SCOPE)] == [
        ("ada", "name"),
        ("plays", "verb"),
        ("knock", "name"),
        ("every", "option"),
        ("1/2", "number"),
        ("until", "option"),
        ("Q", "unknown"),
        ("# why", "comment"),
    ]
    line = "knock = 0mm@0 smooth (6@+1/8)*4"
    kinds = {line[a:b]: kind for a, b, kind in highlighted_tokens(line, SCOPE)}
    assert kinds["="] == "verb"
    assert kinds["mm"] == "unit"
    assert kinds["smooth"] == "curve"
    assert kinds["+1/8"] == "number"


def test_help_names_every_verb_once():
    text = "\n".join(help.overview())
    for form in verbs.FORMS:
        assert text.count(f"  {form.example:<39} {form.effect}") == 1
    assert max(map(len, help.overview())) <= 100


def test_cheat_sheet_equals_generated_text():
    committed = (ROOT / "docs/cheat-sheet.md").read_text(encoding="utf-8")
    assert committed == help.cheat_sheet()  # make docs
