import textwrap
from pathlib import Path

import pytest

from ergon.scores.reading.load import load

DATA = Path(__file__).parent / "data"
DUET = (DATA / "duet-2.2.yaml").read_text(encoding="utf-8")


def check(text, **overlay):
    overlay = {f"{name}.yaml": textwrap.dedent(body) for name, body in overlay.items()}
    return load("s.yaml", text=textwrap.dedent(text), overlay=overlay)


def found(text, **overlay):
    return [(d.code, d.place.line, d.message) for d in check(text, **overlay).diagnostics]


def codes(text, **overlay):
    return [code for code, *_ in found(text, **overlay)]


def duet(text=DUET):
    return load(DATA / "duet-2.2.yaml", text=text)


def test_the_example_loads():
    loaded = load(DATA / "duet-2.2.yaml")
    assert [d.code for d in loaded.diagnostics] == ["N401"]
    piece = loaded.piece
    assert piece.title == "Duet for two keys, a bell and a gong"
    assert (piece.seed, piece.rate) == (20181110, 44100.0)
    assert [m.name for m in piece.marks] == ["A", "B", "C"]
    k1, k2 = piece.keys.values()
    assert k1.modules[0].fields["M"] == 0.4
    assert k1.travel == (-0.015, 0.015)
    # as measured, before what `like` gives
    assert [k2.modules[0].fields[name] for name in "MKZ"] == [0.395, 58.0, 1.1]
    assert k2.travel == (-0.015, 0.015)
    assert list(piece.instruments) == ["gong", "bell", "sky"]  # nothing leads to `plate`
    gong = piece.instruments["gong"].modules[0]
    assert (gong.kind, gong.fields["f"], gong.fields["t60"], gong.fields["M"]) == (
        "PLATE",
        55.0,
        12.0,
        0.3,
    )
    assert piece.instruments["gong"].outputs[0].targets[0].part == "gong"
    b = piece.instruments["bell"].modules[1]
    assert [(t.part, t.module) for t in b.fields["between"]] == [("k1", ""), ("bell", "m")]
    assert b.fields["gap"] == 0.001
    assert len(piece.gestures["roll"].points) == 9
    assert [t.word for t in piece.gestures["soft"].do] == ["scale", "stretch"]
    assert piece.gestures["soft"].points == piece.gestures["lean"].points
    assert piece.takes["remi-7"].trim == (0.4, 4.0)
    rain = piece.strikes[0]
    assert (rain.to[0].part, rain.to[0].first, rain.to[0].count) == ("sky", 0, 100)
    assert rain.impulse == (1e-6, 4e-6)
    assert [(p.player, p.what) for p in piece.parts] == [
        ("ada", "knock"),
        ("ada", "lean"),
        ("ada", "soft"),
        ("remi", "lean"),
        ("remi", "remi-7"),
    ]
    assert piece.mix.channels == 24
    assert len(piece.mix.layout.speakers) == 24
    assert piece.mix.routes[0].to == (1, 2)
    assert piece.mix.master.normalise == pytest.approx(10 ** (-1 / 20))
    assert (piece.render.bits, piece.render.tail) == (24, 12.0)
    duet = piece.duet[0]
    assert (duet.link.kind, duet.link.fields["K"], duet.a.part, duet.b.part) == (
        "REF",
        40.0,
        "k1",
        "k2",
    )


TYPOS = [  # (written, mistyped, code, the word marked, suggestion)
    ("players:", "player:", "E101", "player", "players"),
    ("travel: -15mm", "travl: -15mm", "E101", "travl", "travel"),
    ("M: 400g", "M: 400gr", "E203", "gr", "g"),
    ("play: lean", "play: laen", "E301", "laen", "lean"),
    ("smooth 6mm", "smoth 6mm", "E204", "smoth", "smooth"),
    ("at: C, for", "at: D, for", "E301", "D", None),
    ("at: A, play", "at: 1|0, play", "E204", "1|0", None),
    ("  roll: ", "  knock: ", "E102", "knock", None),
    ("  soft: {", "   soft: {", "E100", None, None),
    ("  soft: {", "\tsoft: {", "E100", None, None),
    ("hand: virtual", "hand: virtul", "E206", "virtul", "virtual"),
    ("K: 60N/m", "K: 60N/n", "E203", "N/n", "N/m"),
    ("from: bell", "from: bel", "E301", "bel", "bell"),
    ("- {at: A, play: knock, every", "- {at: A, play: knock, evry", "E101", "evry", "every"),
    ("mirror", "miror", "E204", "miror", "mirror"),
    ("CEL:", "CLE:", "E101", "CLE", "CEL"),
    ("lean every 8", "lean evry 8", "E204", "evry", "every"),
    ("gong.centre]", "gong.center]", "E301", "gong.center", None),
    ("gong/plate", "gong/plat", "E301", "gong/plat", "plate"),
    ("key: k2", "key: k3", "E301", "k3", None),
]


@pytest.mark.parametrize(("right", "wrong", "code", "word", "suggestion"), TYPOS)
def test_one_mistake_has_one_report_in_its_place(right, wrong, code, word, suggestion):
    assert right in DUET
    text = DUET.replace(right, wrong, 1)
    before, _, _ = DUET.partition(right)
    line = before.count("\n") + 1
    errors = [d for d in duet(text).diagnostics if d.severity == "error"]
    first = errors[0]
    assert (first.code, first.place.line) == (code, line)
    written = text.split("\n")[line - 1]
    if word:
        assert written[first.place.column - 1 :][: first.place.length] == word
    assert first.suggestion == suggestion
    # A section or a gesture that is missing altogether is missed elsewhere.
    assert len(errors) == 1 or word in ("player", "knock")


def test_mistakes_are_told_together_and_in_order():
    text = DUET
    for right, wrong, code, *_ in TYPOS:
        if code != "E100":
            text = text.replace(right, wrong, 1)
    diagnostics = [d for d in duet(text).diagnostics if d.severity == "error"]
    places = [(d.place.line, d.place.column) for d in diagnostics]
    assert places == sorted(places)
    assert len(diagnostics) >= 15


def test_at_most_twenty_are_shown_and_the_rest_counted():
    loaded = check("ergon: 1\nkeys:\n" + "".join(f"  k{i}: {{M: 1N, K: 1}}\n" for i in range(50)))
    assert len(loaded.diagnostics) == 20
    assert loaded.left_out["error"] == 30


# --- files ---------------------------------------------------------------------------------------


def test_a_circle_of_files_is_told_as_a_chain():
    loaded = check("ergon: 1\nuse: [a.yaml]\n", a="use: [b.yaml]\n", b="# b\nuse: [a.yaml]\n")
    d = loaded.diagnostics[0]
    assert (d.code, d.place.file, d.place.line) == ("E302", "b.yaml", 2)
    assert "a.yaml:1:7 -> b.yaml:2:7" in d.message


def test_names_with_a_prefix():
    loaded = check(
        """\
        ergon: 1
        use: {c: common.yaml}
        keys: {k: {M: 1, K: 1}}
        players: {p: {key: k}}
        instruments:
          own: {like: c.bell}
        parts: {p: [{at: 0, play: c.knock}]}
        """,
        common="""\
        gestures:
          knock: {like: base}
          base: 0@0 1@1
        instruments:
          bell: {CEL: {M: 1g, f: A3}, out: {SOX: bell}}
        """,
    )
    assert not loaded.diagnostics
    assert loaded.piece.gestures["c.knock"].points[1].x == 0.001
    assert list(loaded.piece.instruments) == ["own"]
    assert loaded.piece.instruments["own"].outputs[0].targets[0].part == "own"


def test_a_clash_of_names_is_an_error():
    clash = found("ergon: 1\nuse: [a.yaml]\ngestures: {g: 0@0 1@1}\n", a="gestures: {g: 0@0}\n")
    assert [code for code, *_ in clash] == ["E303"]
    assert (
        codes("ergon: 1\nuse: [a.yaml, b.yaml]\n", a="use: [b.yaml]\n", b="gestures: {g: 0@0}")
        == []
    )


def test_missing_files():
    assert codes("ergon: 1\nuse: [none.yaml]\n") == ["E107"]
    assert codes("ergon: 1\ntakes: {t: {file: none.csv}}\n") == ["E107"]
    assert codes("ergon: 1\ntakes: {t: {file: hand.gms}}\n") == ["E108"]
    assert [d.code for d in load("/nowhere/s.yaml").diagnostics] == ["E107"]
    assert [d.code for d in load("/").diagnostics] == ["E107"]


def test_like_in_a_circle():
    text = "ergon: 1\ngestures:\n  a: {like: b}\n  b: {like: a}\n"
    assert codes(text) == ["E302", "E302"]


# --- the formalism -------------------------------------------------------------------------------

NETWORK = """\
ergon: 1
instruments:
  i:
    modules:
      m: {MAS: {M: 1g}}
      n: {MAS: {M: 1g}}
      s: {STRING: {masses: 9, M: 1g, f: A3}}
      r: {REF: {between: [m, n], K: 1}}
      %s
    out: %s
"""


@pytest.mark.parametrize(
    ("module", "out", "code", "part"),
    [
        ("x: {REF: {between: [m, m], K: 1}}", "{}", "E304", "two different points"),
        ("x: {REF: {between: [m, r], K: 1}}", "{}", "E304", "joins <M> points only"),
        ("x: {REF: {between: [m], K: 1}}", "{}", "E106", "2 expected, 1 written"),
        ("x: {REF: {between: [m, s], K: 1}}", "{}", "E304", "9 masses"),
        ("x: {REF: {between: [m, s.9], K: 1}}", "{}", "E304", "members 0 to 8"),
        ("x: {REF: {between: [m, s.all], K: 1}}", "{}", "E304", "one MAT"),
        ("x: {REF: {between: [m, m.0], K: 1}}", "{}", "E304", "no members"),
        ("x: {REF: {between: [m, q], K: 1}}", "{}", "E301", "nothing is called 'q'"),
        ("x: {REF: {between: [m, n]}}", "{}", "E103", "K or Z"),
        ("x: {CEL: {M: 1g, K: 1, f: A3}}", "{}", "E111", "too"),
        ("x: {CEL: {M: 1g}}", "{}", "E103", "needs K"),
        ("x: {CEL: {M: -1g, K: 1}}", "{}", "E202", "not positive"),
        ("x: {CEL: {M: 1g, K: .inf}}", "{}", "E201", "finite"),
        ("x: {BANK: {count: 1e11, M: 1g, f: 20Hz..1kHz, t60: 1s}}", "{}", "E202", "outside"),
        ("x: {BUT: {between: [m, n], K: 1, contact: magic}}", "{}", "E111", "magic"),
        ("x: {MAS: {M: 1g}, SOL: {}}", "{}", "E111", "one kind"),
        ("x: {}", "{}", "E103", "no kind"),
        ("x: {ENX: &e {to: m, from: 1mm}}\n      y: {ENX: *e}", "{}", "E304", "only forces"),
        ("x: {ENX: {to: m, from: hand}}", "{}", "E301", "no take"),
        ("x: {ENF: {to: m, from: tgr0.3}}", "{}", "E108", "axis"),
        ("x: {LNL: {between: [m, n], law: k*d, k: 1N/m, q: 3}}", "{}", "E101", "no constant 'q'"),
        ("x: {LNL: {between: [m, n], law: cubik}}", "{}", "E301", "no law"),
        ("x: {SOL: {}}", "{SOX: r}", "E304", "a REF"),
        ("x: {SOL: {}}", "{SOF: m}", "E304", "force of a link"),
        ("x: {SOL: {}}", "{SOX: [m, o]}", "E301", "'o'"),
        ("m: {SOL: {}}", "{}", "E102", "already defined"),
    ],
)
def test_rules(module, out, code, part):
    reports = found(NETWORK % (module, out))
    assert [report[0] for report in reports] == [code]
    assert part in reports[0][2]


def test_members():
    text = NETWORK % (
        "x: {SOL: {}}",
        "{a: {SOX: s.3..5}, b: {SOX: [m, s.last]}, c: {SOF: {REF: r}}}",
    )
    a, b, c = check(text).piece.instruments["i"].outputs
    assert [(t.first, t.count) for t in a.targets] == [(3, 3)]
    assert [(t.module, t.first) for t in b.targets] == [("m", 0), ("s", 8)]
    assert c.targets[0].module == "r"


def test_algorithmic_units():
    text = """\
    ergon: 1
    instruments:
      i: {units: ca, at: 44100Hz, modules: {m: {CEL: {M: 1, K: 0.01, Z: 1e-4}}}, out: {SOX: m}}
    """
    made = check(text).piece.instruments["i"]
    assert made.ca_rate == 44100.0
    assert made.modules[0].fields["K"] == 0.01
    assert codes(text.replace("K: 0.01", "K: 1N/m")) == ["E203"]
    assert codes(text.replace(", at: 44100Hz", "")) == ["E103"]


# --- time ----------------------------------------------------------------------------------------

PLAYED = """\
ergon: 1
marks: {A: 1|1, B: 3|1}
keys: {k: {M: 1, K: 1}}
players: {p: {key: k}}
gestures: {g: 0@0 1@2}
parts: {p: [%s]}
"""


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ("{at: A, play: g}", []),
        ("{at: A, play: g}, {at: A+1, play: g, layer: true}", []),
        ("{at: B, play: g, until: A}", ["E305"]),
        ("{at: Q, play: g}", ["E301"]),
        ("{at: A-1, play: g}", ["E305"]),
        ("{at: A, play: g, every: 0, times: 3}", ["E305"]),
        ("{at: A, play: g, until: Z}", ["E301"]),
        ("{at: A, play: g, rate: 4kHz}", ["N403"]),
        ("{at: A, play: g, times: 1e9}", ["E204"]),
        ("{at: A, play: g, until: B+100000000}", ["E305"]),
    ],
)
def test_times(entries, expected):
    assert codes(PLAYED % entries) == expected


@pytest.mark.parametrize(
    ("when", "expected"),
    [
        ("every: 1, times: 3", []),
        ("rate: 2Hz, for: 3", []),
        ("times: 3", ["E103"]),
        ("for: 3", ["E103"]),
        ("until: 3", ["E103"]),
    ],
)
def test_many_strikes_say_how_far_apart(when, expected):
    strikes = f"strikes: {{s: {{to: k, at: A, impulse: 1mNs, {when}}}}}\n"
    assert codes(PLAYED % "{at: A, play: g}" + strikes) == expected


def test_a_table_reads_as_a_list_does():
    rows = "A g every 3 times 2 do mirror layer\n    B+1 g rate 4kHz  # twice"
    table = check(PLAYED.replace("{p: [%s]}\n", "\n  p: |\n    ") + rows)
    listed = check(
        PLAYED % "{at: A, play: g, every: 3, times: 2, do: [mirror], layer: true}, "
        "{at: B+1, play: g, rate: 4kHz}"
    )
    assert [d.code for d in table.diagnostics] == [d.code for d in listed.diagnostics] == ["N403"]
    assert table.piece.digest() == listed.piece.digest()


def test_tempo_errors_have_places():
    text = "ergon: 1\ntempo:\n  - {at: 5|1, bpm: 60}\n  - {at: 1|1, bpm: 90}\n"
    reports = check(text).diagnostics
    assert [(d.code, d.place.line, d.place.column) for d in reports] == [("E305", 4, 10)]
    assert codes("ergon: 1\nmarks: {A: B, B: A}\n")[0] == "E305"


def test_bar_checks():
    bars = "{at: A, play: g}"
    assert codes((PLAYED % bars).replace("0@0 1@2", "0@0 1@4 | 2@5")) == []
    assert codes((PLAYED % bars).replace("0@0 1@2", "0@0 1@3 | 2@5")) == ["W311"]


# --- digest --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("# format version", "# other words"),
        ("6mm@1/8 throw", "0.6cm@0.125  throw"),
        ("{M: 400g, K: 60N/m", "{K: 0.06kN/m, M: 0.4kg"),
        ("out/duet.wav", "other.wav"),
        ("marks: {A: 1|1, B: 5|1, C: 9|1}", "marks:\n  C: 9|1\n  A: 1|1\n  B: 5|1"),
    ],
)
def test_the_digest_is_of_values(before, after):
    assert before in DUET
    assert duet(DUET.replace(before, after)).piece.digest() == duet().piece.digest()


@pytest.mark.parametrize(
    ("before", "after"),
    [("seed: 20181110", "seed: 1"), ("6mm@1/8 throw", "6.001mm@1/8 throw"), ("A1", "A2")],
)
def test_the_digest_sees_every_value(before, after):
    assert duet(DUET.replace(before, after)).piece.digest() != duet().piece.digest()


# --- laws ----------------------------------------------------------------------------------------


def law(fields: str) -> str:
    return (
        "ergon: 1\n"
        "instruments:\n"
        "  i:\n"
        "    modules:\n"
        "      g: {SOL: {}}\n"
        "      m: {MAS: {M: 10g}}\n"
        f"      l: {{LNL: {{between: [g, m], {fields}}}}}\n"
        "    out: {SOX: m}\n"
    )


def test_points_of_a_law_have_units():
    bare, written = (
        check(law(f"points: {points}")).piece.digest()
        for points in ("[[-0.001, -2], [0, 0]]", "[[-1mm, -2N], [0, 0]]")
    )
    assert bare == written


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ("[[-1N, -2N], [0, 0]]", ["E203"]),
        ("[[-1mm, 2mm], [0, 0], [x, 1]]", ["E203", "E201"]),
        ("[[0, 0, 0], [1mm, 1N]]", ["E106"]),
        ("[[1mm, 1N], [0, 0]]", ["E207"]),
    ],
)
def test_a_broken_point_is_reported_in_its_place(points, expected):
    assert codes(law(f"points: {points}")) == expected


def test_an_unknown_constant_is_told_from_functions():
    (found,) = check(law("law: rope, kk: 3")).diagnostics
    assert found.suggestion == "k"
    (found,) = check(law("law: rope, stiff: 3")).diagnostics
    assert found.help is not None
    assert "max" not in found.help


COUPLED = """\
ergon: 1
laws: {mine: {law: k*d + q*d**3, k: 40N/m, q: 1e5}}
keys: {k1: {M: 400g, K: 60N/m}, k2: {like: k1}}
duet: {couple: [k1, k2], LNL: {%s}}
"""


def test_a_coupling_names_laws_as_a_module_does():
    link = check(COUPLED % "law: mine, k: 50N/m").piece.duet[0].link
    assert link.fields["law"] == "k*d + q*d**3"
    assert link.fields["constants"] == {"k": 50.0, "q": 1e5}
    assert codes(COUPLED % "law: cubic") == []
    assert codes(COUPLED % "law: cubick") == ["E301"]
    assert codes(COUPLED % "law: k*d") == ["E207"]


def test_a_key_that_does_not_say_where_it_is_struck_is_told_once():
    assert codes("ergon: 1\nkeys: {k: {modules: {m: {MAS: {M: 1}}}}}\n") == ["E103"]
