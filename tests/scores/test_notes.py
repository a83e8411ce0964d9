"""Instruments with notes: one definition at many pitches, whose members are called by note."""

import numpy as np
import pytest
from checked import check, check_reports

from ergon.api.simulate import never_closed_warnings, simulate
from ergon.notation.tables import notes
from ergon.notation.text.errors import TextError
from ergon.scores.edits.matter import set_value
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import stage
from ergon.scores.staging.unused import warn_unused


def piece(text: str) -> Piece:
    loaded = check(f"ergon: 1\n{text}")
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def sound(built: Piece, count: int = 5000) -> np.ndarray:
    staged = stage(built)
    out = np.zeros((count, staged.simulation.n_out))
    staged.simulation.process(out)
    return out


# --- how they are written -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("D3 F3 A3", "D3 F3 A3"),
        ("C3..E3", "C3 C#3 D3 D#3 E3"),
        ("Bb2..Db3", "Bb2 B2 C3 Db3"),
        ("C3..C4 pentatonic", "C3 D3 E3 G3 A3 C4"),
        ("A2 minor count 4", "A2 B2 C3 D3"),
        ("G3 count 3", "G3 G#3 A3"),
        ("Eb4.maj7 C3", "Eb4 G4 Bb4 D5 C3"),
        ("B9 count 1", "B9"),
        ("C-1", "C-1"),
    ],
)
def test_lists_ranges_scales_chords_and_counts(text, expected):
    assert notes.parse_notes(text) == tuple(expected.split())


@pytest.mark.parametrize(
    ("text", "code", "offset", "length", "suggestion"),
    [
        ("D3 H3", "E201", 3, 2, "B3"),
        ("c4", "E201", 0, 2, "C4"),
        ("220", "E201", 0, 3, None),
        ("A3+5cent s", "E201", 9, 1, None),
        ("C5..C3", "E202", 0, 6, "C3..C5"),
        ("C3..", "E201", 4, 1, None),
        ("C3..X5", "E201", 4, 2, None),
        ("C3..C5 pentatonc", "E206", 7, 9, "pentatonic"),
        ("C3 minor count", "E202", 9, 1, None),
        ("C3 minor count 0", "E202", 15, 1, None),
        ("C3..E3 count 9", "E202", 0, 6, None),
        ("B9 count 2", "E202", 0, 2, None),
        ("C3..C5 major from 2", "E204", 13, 4, None),
        ("C#3 Db3", "E202", 0, 1, None),
        ("D3 D3", "E202", 0, 1, None),
        ("A3.minr", "E206", 3, 4, "minor"),
        ("", "E201", 0, 1, None),
    ],
)
def test_parse_notes_mistake_places(text, code, offset, length, suggestion):
    with pytest.raises(TextError) as refused:
        notes.parse_notes(text)
    error = refused.value
    assert (error.code, error.offset, error.length, error.suggestion) == (
        code,
        offset,
        length,
        suggestion,
    )


def test_note_numbers_and_names_round_trip():
    for number in range(notes.LOWEST, notes.HIGHEST + 1):
        for flat in (False, True):
            assert notes.number(notes.name(number, flat=flat)) == number
    assert notes.number("A4") == 69
    assert notes.number("Cb4") == notes.number("B3")
    assert notes.number("m") is None


# --- what they are ------------------------------------------------------------------------------


def test_notes_of_instrument_equal_instrument_retuned():
    built = piece(
        "instruments:\n  string: {from: string/string, notes: [D3, F3, Bb3]}\n"
        "  by-hand: {from: string/string, f: F3}\n"
    )
    assert list(built.instruments) == ["string.D3", "string.F3", "string.Bb3", "by-hand"]
    plain = [dict(m.fields, between=None) for m in built.instruments["by-hand"].modules]
    assert [dict(m.fields, between=None) for m in built.instruments["string.F3"].modules] == plain


def test_note_member_sounds_as_single_instrument():
    gong = "from: gong/plate, PLATE: {radius: 3}"
    by_hand = f"instruments: {{g: {{{gong}, f: F2}}}}\n"
    family = f"instruments: {{g: {{{gong}, notes: [C2, F2]}}}}\n"
    hit = "strikes: {{s: {{to: {}, at: 0, impulse: 1mNs}}}}\n"
    single = sound(piece(by_hand + hit.format("g.centre")))
    member = sound(piece(family + hit.format("g.F2.centre")))
    assert np.abs(single).max() > 0
    assert member[:, 1].tobytes() == single[:, 0].tobytes()


FAMILY = """\
keys: {k1: {M: 400g, K: 60N/m, Z: 1Ns/m}}
instruments:
  string:
    from: string/string
    notes: [D3, F#3, A3]
    modules: {action: {BUT: {between: [k1, hammer], K: 4kN/m, Z: 2Ns/m}}}
  cell: {CEL: {M: 1g, f: A4, t60: 2s}, notes: A3.min7, out: {SOX: cell}}
  gong: {from: gong/plate, PLATE: {radius: 2}, notes: [C2, G2]}
  mic: {modules: {w: {SOL: {}}}, out: {SOX: [string.body.3, gong.G2.4, cell, cell.C4]}}
"""


def test_note_members_in_place_of_modules():
    built = piece(
        f"{FAMILY}strikes: {{s: {{to: [string.hammer, string.Gb3.body.7, gong.centre, cell.E4],"
        " at: 1, impulse: 1mNs}}\n"
        "automation: {set: cell.C4.f, to: A3 C4, every: 1, at: 1}\n"
        "mix: {route: [{from: string, to: 1}, {from: string.Gb3, to: 3}, {from: gong.G2, to: 2},"
        " {from: mic, to: 1}]}\n"
    )
    reached = [(t.part, t.module, t.first) for t in built.strikes[0].to]
    assert reached == [
        ("string.D3", "hammer", 0),
        ("string.F#3", "hammer", 0),
        ("string.A3", "hammer", 0),
        ("string.F#3", "body", 7),
        ("gong.C2", "", "centre"),
        ("gong.G2", "", "centre"),
        ("cell.E4", "", 0),
    ]
    assert [(r.part, r.to) for r in built.mix.routes] == [
        ("string.D3", (1,)),
        ("string.F#3", (1,)),
        ("string.A3", (1,)),
        ("string.F#3", (3,)),
        ("gong.G2", (2,)),
        ("mic", (1,)),
    ]
    listened = [t.part for t in built.instruments["mic"].outputs[0].targets]
    assert listened == [
        *("string.D3", "string.F#3", "string.A3", "gong.G2"),
        *("cell.A3", "cell.C4", "cell.E4", "cell.G4", "cell.C4"),
    ]
    assert built.automation[0].target.part == "cell.C4"


def test_key_acts_on_every_note_member():
    built = piece(FAMILY)
    for name in ("string.D3", "string.F#3", "string.A3"):
        (action,) = [m for m in built.instruments[name].modules if m.name == "action"]
        assert [t.part for t in action.fields["between"]] == ["k1", name]


def test_notes_field_by_like_and_replaced():
    built = piece(f"{FAMILY}  low: {{like: cell, notes: [C2]}}\n  same: {{like: cell}}\n")
    assert [n for n in built.instruments if n.startswith(("low", "same"))] == [
        *("low.C2", "same.A3", "same.C4", "same.E4", "same.G4"),
    ]


def test_notes_of_a_file_with_a_prefix():
    lib = (
        "ergon: 1\ninstruments:\n"
        "  cell: {CEL: {M: 1g, f: A4, t60: 2s}, out: {SOX: cell}, notes: [C4, Gb4]}\n"
        "  ties: {modules: {r: {REF: {between: [cell.C4, cell.F#4], K: 1kN/m, Z: 0}},"
        " w: {SOL: {}}}, out: {SOX: [cell]}}\n"
    )
    text = "ergon: 1\nuse: {lib: lib.yaml}\nmix: {route: [{from: lib.ties, to: 1}]}\n"
    text += "strikes: {s: {to: [lib.cell, lib.cell.F#4], at: 0, impulse: 1mNs}}\n"
    loaded = check(text, lib=lib)
    assert loaded.piece is not None, loaded.diagnostics
    listened = loaded.piece.instruments["lib.ties"].outputs[0].targets
    assert [t.part for t in listened] == ["lib.cell.C4", "lib.cell.Gb4"]
    assert [t.part for t in loaded.piece.strikes[0].to] == [
        *("lib.cell.C4", "lib.cell.Gb4", "lib.cell.Gb4"),
    ]


@pytest.mark.parametrize(
    ("lines", "report"),
    [
        (
            "  b: {BANK: {count: 3, M: 1g, f: 20Hz..1kHz, t60: 1s}, notes: [A3]}\n",
            ("E103", 11, "notes of instrument 'b': a BANK has pitches of its own"),
        ),
        (
            "  b: {modules: {m: {CEL: {M: 1g, K: 1kN/m}}}, notes: [A3]}\n",
            (
                "E103",
                11,
                "notes of instrument 'b': its modules have no named pitch; write `f`, at which "
                "they are written",
            ),
        ),
        (
            "  b: {modules: {r: {BUT: {between: [cell, cell.F3], K: 1kN/m}}}}\n",
            (
                "E304",
                11,
                "BUT 'b.r': 'cell' has 4 notes; write one of them: cell.A3, cell.C4, "
                "cell.E4, cell.G4",
            ),
        ),
        (
            "  b: {like: cell, notes: []}\n",
            ("E106", 11, "notes of instrument 'b': no note is written"),
        ),
        (
            "  b: {like: cell, notes: {C3: 1}}\n",
            (
                "E106",
                11,
                "notes of instrument 'b' is a mapping; expected: notes, such as [D3, F3, A3] or "
                "D3 F3 A3, C3..C5 pentatonic, C3 minor count 8 or A3.min7",
            ),
        ),
    ],
)
def test_notes_field_mistakes_are_refused(lines, report):
    assert check_reports(f"ergon: 1\n{FAMILY}{lines}")[0] == report


def test_missing_note_message_lists_range():
    text = f"ergon: 1\n{FAMILY}strikes: {{s: {{to: cell.F4, at: 1, impulse: 1mNs}}}}\n"
    (message,) = check(text).diagnostics
    expected = "strikes 's': nothing is called 'cell.F4'; the notes of 'cell' are A3 to G4"
    assert (message.code, message.message) == ("E301", expected)
    assert message.suggestion in ("cell.E4", "cell.G4", "cell.A3", "cell.C4")


def test_unused_notes_warn_once_for_instrument():
    struck = "strikes: {s: {to: [string.D3.hammer, gong.C2.centre], at: 0, impulse: 20mNs}}\n"
    built = piece(f"{FAMILY}{struck}render: {{tail: 0.1s}}\n")
    message = [d.message.split(":")[0] for d in warn_unused(built) if d.code == "W322"]
    assert message == ["nothing moves 'cell'"]
    assert not never_closed_warnings(built, simulate(built, "s.yaml"))
    soft = piece(f"{FAMILY}{struck}render: {{tail: 0.1s}}\n".replace("20mNs", "1uNs"))
    message = [
        d.message.split(" never")[0] for d in never_closed_warnings(soft, simulate(soft, "s.yaml"))
    ]
    notes_ = ("D3", "F#3", "A3")
    assert {f"contact 'string.{note}.felt'" for note in notes_} <= {*message}


# --- at the prompt ------------------------------------------------------------------------------


def test_set_field_of_all_notes():
    texts = Texts("s.yaml", f"ergon: 1\n{FAMILY}")
    before = texts.load().piece
    assert before is not None
    after = set_value(texts, before, "string.body.M", "8g").load().piece
    assert after is not None
    for name in ("string.D3", "string.A3"):
        assert after.instruments[name].modules[0].fields["M"] == 8e-3


@pytest.mark.parametrize(
    ("target", "value", "part", "field", "expected"),
    [
        ("string.A3.body.M", "8g", "string.A3", "M", 8e-3),
        ("string.Gb3.body.t60", "5s", "string.F#3", "t60", 5.0),
        ("string.A3.body.f", "x2", "string.A3", "f", 440.0),
        ("gong.G2.t60", "5s", "gong.G2", "t60", 5.0),
        ("gong.G2.f", "C3", "gong.G2", "f", 130.8127826502993),
        ("cell.C4.K", "2kN/m", "cell.C4", "K", 2e3),
        ("cell.C4.f", "A3", "cell.C4", "f", 220.0),
    ],
)
def test_set_field_of_one_note(target, value, part, field, expected):
    texts = Texts("s.yaml", f"ergon: 1\n{FAMILY}")
    before = texts.load().piece
    assert before is not None
    changed = set_value(texts, before, target, value)
    changed = set_value(changed, before, target, value) if not value.startswith("x") else changed
    loaded = changed.load()
    assert loaded.piece is not None, loaded.diagnostics
    assert loaded.piece.instruments[part].modules[0].fields[field] == pytest.approx(expected)
    for name, instrument in loaded.piece.instruments.items():
        if name not in (part, "mic"):
            plain = [dict(m.fields, between=None) for m in before.instruments[name].modules]
            assert [dict(m.fields, between=None) for m in instrument.modules] == plain


def test_members_field_overrides_fields_of_notes():
    built = piece(
        "instruments:\n  s: {from: string/string, notes: [D3, F#3], members:"
        " {Gb3: {modules: {body: {STRING: {masses: 70}}, felt: {BUT: {gap: 5mm}}}}}}\n"
        "  g: {from: gong/plate, notes: [C2, G2], members: {G2: {t60: 3s, PLATE: {radius: 3}}}}\n"
    )
    masses = [built.instruments[f"s.{note}"].modules[0].fields["masses"] for note in ("D3", "F#3")]
    assert masses == [60, 70]
    plates = [built.instruments[f"g.{note}"].modules[0].fields for note in ("C2", "G2")]
    assert [(f["t60"], f["radius"], f["f"]) for f in plates] == [
        (30.0, 8, 65.40639132514966),
        (3.0, 3, 97.99885899543733),
    ]


@pytest.mark.parametrize(
    ("members", "report"),
    [
        ("{A3: {M: 2g}}", ("E301", "members of instrument 'c': it has no note 'A3'")),
        (
            "{H3: {M: 2g}}",
            (
                "E201",
                "members of instrument 'c': 'H3' is neither a frequency such as 220Hz nor a note "
                "such as A3 or Bb2",
            ),
        ),
        ("{C3: {like: c}}", ("E101", "unknown field 'like' in instrument 'c'")),
        (
            "[C3]",
            (
                "E106",
                "members of instrument 'c' is a list; expected: notes, each with fields, such as "
                "F3: {t60: 3s}",
            ),
        ),
    ],
)
def test_members_field_with_unknown_note_is_refused(members, report):
    cell = "{CEL: {M: 1g, f: A4, t60: 2s}, notes: [C3, D3], members: "
    text = f"ergon: 1\ninstruments:\n  c: {cell}{members}}}\n"
    assert [(code, message) for code, _, message in check_reports(text)] == [report]
