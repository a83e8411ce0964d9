"""From typed lines to commands, or to a refusal with its place and a better line."""

import dataclasses
import random
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergon.repl.language import commands as c
from ergon.repl.language import help, verbs
from ergon.repl.language.complete import complete
from ergon.repl.language.highlight import tokens
from ergon.repl.language.lines import MAX_LINE, MAX_PASTE, is_whole
from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import Names, names
from ergon.scores.clock.positions import Length, Position, parse_position
from ergon.scores.gesture import notation
from ergon.scores.gesture.transforms import parse_chain
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import UNSAID, Manner

ROOT = Path(__file__).parents[1]
ONE = Length(beats=1.0)


def _scope() -> Names:
    piece = load(ROOT / "tests/data/duet-2.2.yaml").piece
    assert piece is not None
    known = names(piece)
    return dataclasses.replace(known, takes={**known.takes, "solo": "take"})


SCOPE = _scope()


def one(line: str) -> c.Command:
    (command,) = parse(line, SCOPE)
    return command


def refused(text: str) -> Refusal:
    with pytest.raises(Refusal) as caught:
        parse(text, SCOPE)
    return caught.value


def chain(text: str, start: int = 0):
    return tuple(
        dataclasses.replace(transform, offset=transform.offset + start)
        for transform in parse_chain(text)
    )


def plays(what: str, **more) -> c.Plays:
    nothing = dict.fromkeys(("every", "times", "until"))
    return c.Plays("ada", what, **{**nothing, "do": (), "manner": UNSAID, **more})


# The example session of the design, and every form that it leaves out.
KNOCK = "0@0 smooth 7@1/8 smooth 0@1/4"
SESSION = [
    ("play", c.Play(None)),
    ("ada plays knock every 1                  # at the next bar", plays("knock", every=ONE)),
    (f"knock = {KNOCK}     # while sounding", c.Define("knock", notation.parse(KNOCK))),
    ("? lean                                   # draws it", c.Look("lean")),
    ("ada plays lean now                       # overrides quant", plays("lean", when=c.NOW)),
    ("ada do mirror, scale 1.2", c.Do("ada", chain("mirror, scale 1.2"))),
    ("set bell.m.K x1.5 over 2bar   # glides", c.Set("bell.m.K", None, 1.5, Length(bars=2))),
    ("tempo 60 -> 84 over 4bar", c.Tempo(60, 84, Length(bars=4))),
    ("couple k1 k2 K=40N/m", c.Couple("k1", "k2", 40.0, 0.0)),
    ("record remi as solo-2", c.Record("remi", "solo-2")),
    ("record off", c.RecordOff()),
    (
        "ada plays solo from 4 stretch 2",
        plays("solo", do=(*chain("from 4", 5), *chain("stretch 2", 12))),
    ),
    ("undo                                     # at the next bar", c.Undo()),
    ("keep 8bar as verse-2", c.Keep(Length(bars=8), "verse-2")),
    ("hush", c.Hush()),
    ("damp 3s", c.Damp(3.0)),
    ("save scores/duet-live.yaml               # comments kept", c.Save("scores/duet-live.yaml")),
    ("quit", c.Quit()),
]
OTHERS = [
    ("play from B+2", c.Play(parse_position("B+2"))),
    ("stop at C", c.Stop(when=parse_position("C"))),
    ("set bell.m.K 900N/m in 2", c.Set("bell.m.K", 900.0, None, None, when=Length(beats=2))),
    ("set k1.M 350g", c.Set("k1.M", 0.35, None, None)),
    ("set gong.f A1", c.Set("gong.f", 55.0, None, None)),
    ("tempo 72", c.Tempo(72)),
    ("tap", c.Tap()),
    ("nudge -10ms", c.Nudge(Length(seconds=-0.01))),
    ("quant now", c.Quant(c.NOW)),
    ("quant 2bar", c.Quant(Length(bars=2))),
    ("uncouple k1 k2 at 9|1", c.Uncouple("k1", "k2", when=parse_position("9|1"))),
    ("couple k1 k2 Z=0.2Ns/m K=1kN/m", c.Couple("k1", "k2", 1000.0, 0.2)),
    ("guide remi ada K=30N/m", c.Guide("remi", "ada", 30.0)),
    ("guide remi off", c.Guide("remi", None)),
    ("gain ada x0.5", c.Gain("ada", 0.5)),
    ("gain 0dB", c.Gain(None, 1.0)),
    ("mute bell", c.Mute("bell")),
    ("solo gong now", c.Solo("gong", when=c.NOW)),
    ("unmute", c.Unmute(None)),
    ("unmute bell", c.Unmute("bell")),
    ("meters", c.Meters()),
    ("rest ada", c.Rest("ada")),
    ("rest all", c.Rest(None)),
    ("panic now", c.Panic()),
    ("release", c.Release()),
    ("redo", c.Redo()),
    ("history", c.History()),
    ("back 3", c.Back(3)),
    ("save", c.Save(None)),
    ('load "my pieces/duet.yaml" at C', c.Load("my pieces/duet.yaml", when=parse_position("C"))),
    ("reload", c.Reload()),
    ("seed 18446744073709551615", c.Seed(2**64 - 1)),
    ("show", c.Show(None)),
    ("show ada", c.Show("ada")),
    ("scope k1", c.Trace("k1")),
    ("help", c.Help(None)),
    ("help te", c.Help("tempo")),
    ("help record", c.Help("record")),
    ("py [x for x in 'a # b']", c.Py("[x for x in 'a # b']")),
    ("knock=0@0 7@1/8", c.Define("knock", notation.parse("0@0 7@1/8"))),
    ("new = 0@0 7@1/8 at B", c.Define("new", notation.parse("0@0 7@1/8"), when=Position("B"))),
    ("?lean", c.Look("lean")),
    ("? bell.m.K", c.Look("bell.m.K")),
    ("ada p knock", plays("knock")),
    (
        "ada plays knock at 3|1 every 1/2 times 8 until C layer touch tracked grain 5ms",
        plays(
            "knock",
            every=Length(beats=0.5),
            times=8,
            until=parse_position("C"),
            manner=Manner(touch="tracked", grain=0.005, layer=True),
            when=parse_position("3|1"),
        ),
    ),
]


def alike(command: c.Command) -> c.Command:
    """Without how a mark was spelt: `Position.text` is no value."""
    at = command.when
    return (
        dataclasses.replace(command, when=dataclasses.replace(at, text=""))
        if isinstance(at, Position)
        else command
    )


@pytest.mark.parametrize(("line", "command"), SESSION + OTHERS)
def test_a_line_is_what_it_says(line: str, command: c.Command):
    assert alike(one(line)) == alike(command)


def test_every_command_is_reached_by_a_line_above():
    asked = {type(command) for _, command in SESSION + OTHERS}
    assert asked == {
        thing
        for thing in vars(c).values()
        if isinstance(thing, type) and issubclass(thing, c.Command) and thing is not c.Command
    }


@pytest.mark.parametrize("form", verbs.FORMS, ids=lambda form: form.written)
def test_the_example_of_every_verb_is_taken(form: verbs.Form):
    assert isinstance(one(form.example.replace("as solo", "as solo-2")), c.Command)
    text = "\n".join(help.about(form.verb))
    assert form.written in text
    assert form.example in text


def test_values_are_kept_as_written_and_where():
    line = "ada plays knock every 1/2 do scale 0.5, mirror until C  in 2bar"
    words = one(line).words
    assert {name: word.text for name, word in words.items()} == {
        "player": "ada",
        "what": "knock",
        "every": "1/2",
        "until": "C",
        "do": "scale 0.5, mirror",
        "when": "2bar",
        "play": "knock every 1/2 until C do scale 0.5, mirror",
    }
    assert all(
        line[word.start : word.end] == word.text
        for name, word in words.items()
        if name not in ("do", "play")
    )
    assert one("couple k1 k2 K=40N/m").words["stiffness"] == ("40N/m", 15, 20)
    said = one("ada plays knock at B layer every 2").words
    assert said["when"] == ("B", 19, 20)
    assert said["play"].text == "knock every 2 layer"
    assert one("set bell.m.K 1kN/m now").words["change"].text == "1kN/m"


# --- several lines -------------------------------------------------------------------------------


def test_a_pasted_block_is_several_commands():
    block = """\
# the second verse
verse = 0@0 6@1 \\
        0@2          # goes on

ada plays verse every 2 \\
   times 4
\ttempo 72 at C\r
"""
    define, play, tempo = parse(block, SCOPE)
    assert define == c.Define("verse", notation.parse("0@0 6@1" + " " * 11 + "0@2"))
    assert play == plays("verse", every=Length(beats=2), times=4)
    assert tempo == c.Tempo(72, when=parse_position("C"))
    times = play.words["times"]
    assert block[times.start : times.end] == "4"


def test_a_block_with_one_bad_line_is_refused_and_put_right_whole():
    block = "ada plays knock\nremi plyas lean # or roll\n"
    refusal = refused(block)
    assert block[refusal.offset :].startswith("plyas")
    assert refusal.message == "line 2: unknown verb 'plyas'"
    assert refusal.try_ == "ada plays knock\nremi plays lean # or roll\n"


@pytest.mark.parametrize("text", ["", "  \n\n", "# only this", "\t# x \\"])
def test_nothing_is_said_by_comments(text: str):
    assert parse(text, SCOPE) == ()


def test_a_line_that_goes_on_is_not_whole():
    assert not is_whole("ada plays knock \\")
    assert not is_whole("play\nada plays \\  ")
    assert is_whole("ada plays knock")
    assert is_whole("play # or not \\")
    assert is_whole("ada plays \\\n knock")


def test_a_hash_inside_a_word_begins_no_comment():
    assert one("set gong.f A#1") == c.Set("gong.f", pytest.approx(58.27, abs=0.01), None, None)


# --- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "at_fault", "better"),
    [
        ("ada plyas leen", "plyas", "ada plays lean"),
        ("aad plyas leen", "aad", "ada plays lean"),
        ("ada plays knok every 1", "knok", "ada plays knock every 1"),
        ("ada plays knock evry 1", "evry", "ada plays knock every 1"),
        ("ada do scael 0.5", "scael", "ada do scale 0.5"),
        ("knock every 1", "knock", "ada plays knock every 1"),
        ("knock = 0@0 smoth 6@1", "smoth", "knock = 0@0 smooth 6@1"),
        ("set bel.m.K x2", "bel.m.K", "set bell.m.K x2"),
        ("set bell.m.k x2", "bell.m.k", "set bell.m.K x2"),
        ("set bell.m.K 900N/mm/s", "N/mm/s", "set bell.m.K 900N/mm"),
        ("gain bell -6", "-6", "gain bell -6dB"),
        ("temop 72", "temop", "tempo 72"),
        ("tempo 72 nwo", "72 nwo", None),
        ("hush nwo", "nwo", "hush now"),
        ("record remi as solo", "solo", "record remi as solo-2"),
        ("record remi os lala", "os", None),
        ("quant bra", "bra", "quant bar"),
        ("uncuple k1 k2", "uncuple", "uncouple k1 k2"),
        ("save my piece.yaml", "piece.yaml", None),
        ("ada\xa0plays knock", "\xa0", "ada plays knock"),
        ("ada plays \x1bknock\x00", "\x1bknock\x00", "ada plays knock"),
    ],
)
def test_a_refusal_has_a_place_and_a_better_line(line: str, at_fault: str, better: str | None):
    refusal = refused(line)
    assert line[refusal.offset : refusal.offset + refusal.length] == at_fault
    assert refusal.try_ == better
    if better is not None:
        assert parse(better, SCOPE)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("set bell.m.K 900N", "unit 'N' does not measure stiffness"),
        ("set k1.M 2s", "unit 's' does not measure mass"),
        ("set bell.m.K x-1", "negative"),
        ("damp 3", "'3' has no unit"),
        ("link on", "not built yet"),
        ("u", "'u' may be uncouple or unmute or undo"),
        ("help re", "'re' may be"),
        ("ada plays knock until Q", "'Q' is not a mark"),
        ("stop at Q+2", "'Q' is not a mark"),
        ("ada plays knock at B now", "said twice"),
        ("ada plays knock every", "'every' needs a value"),
        ("ada plays knock every 0", "no time at all"),
        ("ada plays knock rate 4kHz", "audio rate"),
        ("ada plays solo from B", "is not a time"),
        ("ada plays", "a gesture or a take is missing"),
        ("ada", "plays or does what?"),
        ("stop at", "'at' wants a position"),
        ("panic at C", "acts at once"),
        ("rest", "is missing"),
        ("couple k1 k2", "K or Z"),
        ("couple k1 k1 K=1N/m", "'k1' twice"),
        ("guide remi remi", "'remi' twice"),
        ("gain bell", "a level is missing"),
        ("couple k1 k2 K=", "'K=' wants a stiffness"),
        ("tempo 60 over 4bar", "a ramp says"),
        ("tempo 60 -> 90", "a ramp says"),
        ("quant 1s", "not on seconds"),
        ("back 0", "outside 1 to"),
        ("every = 0@0 6@1", "'every' is a word of these lines"),
        ("solo = 0@0 6@1", "'solo' is a take"),
        ("9th = 0@0 6@1", "is not a name"),
        ("knock = ", "is missing"),
        ("knock = 0@0 throw", "leads into no point"),
        ("knock = 0@0 (1@1 0@2)*90000", "more than 2,000 points"),
        ('load "duet.yaml', "not closed"),
        ("xyz", "unknown verb 'xyz'"),
        ("= 0@0", "unknown verb '='"),
        ("x" * (MAX_LINE + 1), "10,000 are the most"),
        ("play\n" * MAX_PASTE, "100,000 are the most"),
        ("play\n" * 201, "more than 200 lines"),
    ],
)
def test_what_is_refused_says_why(line: str, reason: str):
    refusal = refused(line)
    assert reason in refusal.message
    assert "\n" not in refusal.message
    assert refusal.try_ is None or parse(refusal.try_, SCOPE)


def test_a_name_may_be_that_of_a_verb():
    """`tempo.yaml` has a gesture `tap`; players are called what they are called."""
    scope = dataclasses.replace(
        SCOPE, gestures={"tap": "", "help": ""}, players={"set": "", "ada": ""}
    )
    assert isinstance(parse("ada plays tap", scope)[0], c.Plays)
    assert isinstance(parse("tap", scope)[0], c.Tap)
    assert isinstance(parse("help = 0@0 1@1", scope)[0], c.Define)
    assert isinstance(parse("set plays help", scope)[0], c.Plays)
    assert isinstance(parse("set bell.m.K x2", scope)[0], c.Set)


def test_a_mark_with_a_minus_is_a_mark():
    scope = dataclasses.replace(SCOPE, marks={"verse-2": ""})
    (stop,) = parse("stop at verse-2", scope)
    assert isinstance(stop.when, Position)
    assert stop.when.text == "verse-2"


# --- short forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize("among", [verbs.VERBS, verbs.SUBJECT_VERBS])
def test_every_shortest_form_means_one_verb_and_so_does_all_that_is_longer(among: tuple[str, ...]):
    for verb in among:
        for length in range(len(verbs.SHORTEST[verb]), len(verb) + 1):
            assert verbs.meant(verb[:length], among) == (verb,)


def test_a_verb_that_is_added_later_takes_no_short_form_away(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(verbs.SHORTEST, "hum", "hum")
    later = (*verbs.VERBS, "hum")
    assert verbs.meant("hu", later) == ("hush",)
    assert verbs.meant("hum", later) == ("hum",)


# --- completion, colours, help -------------------------------------------------------------------


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
def test_completion_offers_what_could_follow(line: str, some: set[str]):
    found = complete(line, len(line), SCOPE)
    assert some <= {s.text for s in found}
    for suggestion in found:
        assert suggestion.hint
        assert "\n" not in suggestion.hint
        assert suggestion.text.lower().startswith(line[suggestion.start :].lower())


def test_completion_offers_nothing_that_would_be_refused():
    assert offered("ada plays knock every n") == []  # `now` is no length
    assert offered("ada plays knock # ") == []
    assert offered("xyz ") == []
    assert "over" not in offered("stop ")


UNFINISHED = re.compile(
    "missing|wants|needs|leads into no point|plays or does|K or Z|ramp|is not a tempo|write it as"
)


@pytest.mark.parametrize("line", [line.split(" #")[0] for line, _ in SESSION + OTHERS])
def test_what_is_offered_is_taken_or_only_unfinished(line: str):
    for cut in [i for i, character in enumerate(line) if character == " "]:
        head = line[: cut + 1]
        for suggestion in complete(head, len(head), SCOPE):
            text = head[: suggestion.start] + suggestion.text
            if suggestion.text[-1] not in ".@":  # `bell.` and `6mm@` go on
                assert UNFINISHED.search(sentence(text)), text


def sentence(text: str) -> str:
    """Why a text is refused; for one that is taken, that nothing is missing."""
    try:
        parse(text, SCOPE)
    except Refusal as refusal:
        return refusal.message
    return "nothing is missing"


def test_completion_looks_at_the_cursor_only():
    assert offered("ada pl knock every 1", 6) == ["plays"]


def test_colours_of_a_line():
    line = "ada plays knock every 1/2 until Q # why"
    assert [(line[a:b], kind) for a, b, kind in tokens(line, SCOPE)] == [
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
    kinds = {line[a:b]: kind for a, b, kind in tokens(line, SCOPE)}
    assert kinds["="] == "verb"
    assert kinds["mm"] == "unit"
    assert kinds["smooth"] == "curve"
    assert kinds["+1/8"] == "number"


def test_help_names_every_verb_once():
    text = "\n".join(help.overview())
    for form in verbs.FORMS:
        assert text.count(f"  {form.example} ") == 1
    assert max(map(len, help.overview())) <= 100


def test_the_committed_cheat_sheet_is_that_of_the_table():
    committed = (ROOT / "docs/cheat-sheet.md").read_text(encoding="utf-8")
    assert committed == help.sheet()  # make docs


# --- hostile lines -------------------------------------------------------------------------------


def holds(text: str) -> None:
    """What is true of any text at all: commands or a Refusal, and places inside the text."""
    refusal = None
    try:
        assert all(isinstance(command, c.Command) for command in parse(text, SCOPE))
    except Refusal as caught:
        refusal = caught
    if refusal is not None:
        assert refusal.message.isprintable()
        assert refusal.message
        assert 0 <= refusal.offset <= len(text)
        assert refusal.try_ != text
        assert refusal.try_ is None or isinstance(parse(refusal.try_, SCOPE), tuple)
    last = 0
    for start, end, kind in tokens(text, SCOPE):
        assert last <= start < end <= len(text)
        assert kind in {
            "verb", "name", "option", "curve", "number", "unit", "comment", "unknown"
        }  # fmt: skip
        last = end
    cursor = len(text) * 2 // 3
    for suggestion in complete(text, cursor, SCOPE):
        assert 0 <= suggestion.start <= cursor


LINES = [line for line, _ in SESSION + OTHERS]
CHARACTERS = (
    "abkKQ019 \t.,;:|@+-*/=()[]{}#\\\"'?\n\r\x00\x07\x1b\x7f\x85\xa0\u2028éµ名😀\ud800\udfff\u202e"
)
WORDS = [
    *{word for line in LINES for word in line.split()},
    *verbs.SHORTEST.values(), "at", "in", "over", "do", "1e999", "-1", "1/0", "9" * 5000, "nan",
    "0@0", "(6@1/8", "0@1/4)*4", "|", "K=", "=", "x", "3|9", "A-1bar", ",", "(" * 50, "*",
]  # fmt: skip


def hostile(rng: random.Random) -> str:
    kind = rng.random()
    if kind < 0.4:  # words in no order
        return " ".join(rng.choices(WORDS, k=rng.randrange(9)))
    if kind < 0.5:  # garbage
        return "".join(rng.choices(CHARACTERS, k=rng.randrange(60)))
    line = rng.choice(LINES)  # a line that is nearly right
    for _ in range(rng.randrange(1, 4)):
        at = rng.randrange(len(line) + 1)
        line = line[:at] + rng.choice(CHARACTERS) * rng.randrange(3) + line[at + rng.randrange(4) :]
    return line


def test_twenty_thousand_hostile_lines():
    rng = random.Random(20181110)
    for _ in range(20_000):
        holds(hostile(rng))


@given(st.text(st.characters(codec=None), max_size=80))
def test_any_text_is_taken_or_refused(text: str):
    holds(text)


PIECES = (
    "x", "(", "0@0 ", "ada plays ", "\x00", "=", '"', "\\\n", "#", "9", "é\u0301", "a,", "?", ". "
)  # fmt: skip


@pytest.mark.parametrize("piece", PIECES)
@pytest.mark.parametrize("size", [MAX_LINE - 5, 1_000_000])
def test_huge_text_is_taken_or_refused(piece: str, size: int):
    for head in ("", "knock = ", "set ", "ada plays knock ", "tempo ", "py "):
        holds(head + piece * (size // len(piece)))
