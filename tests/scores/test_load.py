from dataclasses import replace
from pathlib import Path

import pytest
from checked import check, check_reports, codes

from ergon.notation.tables.strengths import Level, Levels
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests/data"
DUET = (DATA / "duet-2.2.yaml").read_text(encoding="utf-8")


def duet(text=DUET):
    return load(DATA / "duet-2.2.yaml", text=text)


def test_load_of_example_duet():
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
    assert rain.levels == Levels((Level(1e-6, 4e-6),))
    assert [(p.player, p.played_text) for p in piece.parts] == [
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
def test_typo_message_place_and_suggestion(right, wrong, code, word, suggestion):
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


def test_mistakes_reported_together_in_order():
    text = DUET
    for right, wrong, code, *_ in TYPOS:
        if code != "E100":
            text = text.replace(right, wrong, 1)
    diagnostics = [d for d in duet(text).diagnostics if d.severity == "error"]
    places = [(d.place.line, d.place.column) for d in diagnostics]
    assert places == sorted(places)
    assert len(diagnostics) >= 15


def test_diagnostics_above_twenty_are_counted():
    loaded = check("ergon: 1\nkeys:\n" + "".join(f"  k{i}: {{M: 1N, K: 1}}\n" for i in range(50)))
    assert len(loaded.diagnostics) == 20
    assert loaded.left_out["error"] == 30


# --- files ---------------------------------------------------------------------------------------


def test_circular_use_reported_as_chain():
    loaded = check("ergon: 1\nuse: [a.yaml]\n", a="use: [b.yaml]\n", b="# b\nuse: [a.yaml]\n")
    d = loaded.diagnostics[0]
    assert (d.code, d.place.file, d.place.line) == ("E302", "b.yaml", 2)
    assert "a.yaml:1:7 -> b.yaml:2:7" in d.message


def test_names_of_used_file_with_prefix():
    loaded = check(
        """\
        ergon: 1
        use: {c: common.yaml}
        keys: {k: {M: 1kg, K: 1}}
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


def test_name_clash_between_files_is_an_error():
    clash = check_reports(
        "ergon: 1\nuse: [a.yaml]\ngestures: {g: 0@0 1@1}\n", a="gestures: {g: 0@0}\n"
    )
    assert [code for code, *_ in clash] == ["E303"]
    assert (
        codes("ergon: 1\nuse: [a.yaml, b.yaml]\n", a="use: [b.yaml]\n", b="gestures: {g: 0@0}")
        == []
    )


@pytest.mark.parametrize(
    ("file", "help"),
    [
        ("layouts/stereo.yaml", "a layout is named by the mix: `layout: FILE`"),
        ("calib/crm-key-03.yaml", "a calibration is named by a key: `calib: FILE`"),
    ],
)
def test_load_of_wrong_file_kind_has_one_message(file, help):
    (found,) = load(ROOT / "scores/library" / file).diagnostics
    assert (found.code, found.help) == ("E101", help)


def test_missing_files_error_codes():
    assert codes("ergon: 1\nuse: [none.yaml]\n") == ["E107"]
    assert codes("ergon: 1\ntakes: {t: {file: none.csv}}\n") == ["E107"]
    assert codes("ergon: 1\ntakes: {t: {file: hand.gms}}\n") == ["E108"]
    assert [d.code for d in load("/nowhere/s.yaml").diagnostics] == ["E107"]
    assert [d.code for d in load("/").diagnostics] == ["E107"]


def test_like_cycle_error_codes():
    text = "ergon: 1\ngestures:\n  a: {like: b}\n  b: {like: a}\n"
    assert codes(text) == ["E302", "E302"]


# --- time ----------------------------------------------------------------------------------------

PLAYED = """\
ergon: 1
marks: {A: 1|1, B: 3|1}
keys: {k: {M: 1kg, K: 1}}
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
def test_part_entry_times_and_their_error_codes(entries, expected):
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
def test_strikes_repeated_without_spacing_are_refused(when, expected):
    strikes = f"strikes: {{s: {{to: k, at: A, impulse: 1mNs, {when}}}}}\n"
    assert codes(PLAYED % "{at: A, play: g}" + strikes) == expected


def test_part_as_table_equals_part_as_list():
    rows = "A g every 3 times 2 do mirror layer\n    B+1 g rate 4kHz  # twice"
    table = check(PLAYED.replace("{p: [%s]}\n", "\n  p: |\n    ") + rows)
    listed = check(
        PLAYED % "{at: A, play: g, every: 3, times: 2, do: [mirror], layer: true}, "
        "{at: B+1, play: g, rate: 4kHz}"
    )
    assert [d.code for d in table.diagnostics] == [d.code for d in listed.diagnostics] == ["N403"]
    assert digest_of(table.piece) == digest_of(listed.piece)


def test_tempo_errors_have_places():
    text = "ergon: 1\ntempo:\n  - {at: 5|1, bpm: 60}\n  - {at: 1|1, bpm: 90}\n"
    reports = check(text).diagnostics
    assert [(d.code, d.place.line, d.place.column) for d in reports] == [("E305", 4, 10)]
    assert codes("ergon: 1\nmarks: {A: B, B: A}\n")[0] == "E305"


def test_bar_checks_warn_of_wrong_bars():
    bars = "{at: A, play: g}"
    assert codes((PLAYED % bars).replace("0@0 1@2", "0@0 1@4 | 2@5")) == []
    assert codes((PLAYED % bars).replace("0@0 1@2", "0@0 1@3 | 2@5")) == ["W311"]


# --- digest --------------------------------------------------------------------------------------


BODIES = """\
ergon: 1
instruments:
  s:
    modules:
      a: {STRING: {masses: 9, M: 5g, f: A3, t60: 2s}}
      b: {PLATE: {radius: 2, M: 80g, f: 90Hz, t60: 3s}}
    out: {SOX: a.3}
strikes: {tap: {to: s.b.0, at: 1|1, every: 1, times: 2, impulse: 1mNs}}
"""


def test_digest_equals_stored_value():
    """Computed by the version before `inharmonicity`, `stretching`, `sides` and `bending`."""
    digest = "a2898cbdf3a77701bf2c5d822b87760138fa714f800a00ab90089d7248db3fc8"
    piece = load("s.yaml", text=BODIES).piece
    assert piece is not None
    spec = replace(piece.render, tail=5.0)  # which was the default
    assert digest_of(replace(piece, render=spec)) == digest
    stiff = load("s.yaml", text=BODIES.replace("t60: 2s", "t60: 2s, inharmonicity: 1e-4")).piece
    assert stiff is not None
    assert digest_of(stiff) != digest


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
def test_digest_unchanged_by_equal_values(before, after):
    assert before in DUET
    assert digest_of(duet(DUET.replace(before, after)).piece) == digest_of(duet().piece)


@pytest.mark.parametrize(
    ("before", "after"),
    [("seed: 20181110", "seed: 1"), ("6mm@1/8 throw", "6.001mm@1/8 throw"), ("A1", "A2")],
)
def test_digest_changes_with_every_value(before, after):
    assert digest_of(duet(DUET.replace(before, after)).piece) != digest_of(duet().piece)


def test_instruments_of_a_file_with_a_prefix_name_each_other():
    lib = (
        "ergon: 1\ninstruments:\n  a: {CEL: {M: 1g, f: A4, t60: 2s}}\n"
        "  b: {modules: {m: {CEL: {M: 1g, f: A4}}, r: {REF: {between: [m, a], K: 1kN/m, Z: 0}}},"
        " out: {SOX: m}}\n"
    )
    used = "ergon: 1\nuse: {c: lib.yaml}\nmix: {route: [{from: c.b, to: 1}]}\n"
    loaded = check(used, lib=lib)
    assert loaded.piece is not None, loaded.diagnostics
    assert list(loaded.piece.instruments) == ["c.a", "c.b"]
