"""What a new user types first and is refused: one message, at its place, with what is meant."""

from __future__ import annotations

import pytest

from ergon.scores.reading.load import load
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import stage

SCORE = """\
ergon: 1
use: [instruments/bell.yaml]
tempo:
  - {at: 1|1, bpm: 72}
  - {at: 3|1, bpm: 72 -> 40, over: 2bar}
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}
gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@120ms}
players: {ada: {key: k}, bob: {key: k}}
parts:
  ada: [{at: 1|1, play: knock}]
strikes: {tap: {at: 1|1, to: bell.hum, every: 1, times: 2, impulse: 1mNs}}
mix: {channels: 1, route: [{from: bell, to: 1, gain: -6dB}]}
render: {tail: 4s}
"""


def read(old: str = "", new: str = ""):
    assert old in SCORE
    return load("s.yaml", text=SCORE.replace(old, new, 1))


def test_base_score_without_diagnostics():
    assert not read().diagnostics


@pytest.mark.parametrize(
    ("old", "new", "line", "column", "suggestion"),
    [
        ("instruments/bell.yaml", "bell.yaml", 2, 7, "instruments/bell.yaml"),
        ("instruments/bell.yaml", "instruments/bel.yaml", 2, 7, "instruments/bell.yaml"),
        ("72 -> 40", "72..40", 5, 20, "72 -> 40"),
        ("2bar", "2 bars", 5, 36, "2bars"),
        ("-6dB", "0.5", 12, 54, "x0.5"),
        ("4s", "4,5s", 13, 16, "4.5s"),
        ("1.2Ns/m", "1,2Ns/m", 6, 34, "1.2Ns/m"),
        ("-15mm", "\u221215mm", 6, 51, "-15mm"),
        ("{at: 1|1, play", "{at: '5:1', play", 10, 15, "5|1"),
        ("play: knock", "play: knock, repeat: 3", 10, 32, "times"),
        ("times: 2", "repeat: 2", 11, 50, "times"),
        ("mix:", "include: [{score: other.yaml}]\nmix:", 12, 12, "file"),
    ],
)
def test_single_message_with_place_and_suggestion(old, new, line, column, suggestion):
    (error,) = read(old, new).diagnostics
    assert (error.place.line, error.place.column) == (line, column)
    assert error.suggestion == suggestion


@pytest.mark.parametrize(
    ("old", "new", "help"),
    [
        ("{at: 1|1, play", "{at: [0, 1, 2], play", "repeat the entry, once for each value"),
        ("play: knock", "play: knock, loud: 3", "known here: at, play, every, times, until"),
        ("{tail: 4s}", "[{tail: 4s}]", "a group of fields is written: file, bits"),
    ],
)
def test_single_message_with_help(old, new, help):
    (error,) = read(old, new).diagnostics
    assert error.help is not None
    assert help in error.help


def test_missing_colon_message_at_its_line():
    (error,) = load("s.yaml", text="ergon: 1\ntitle Base\nkeys: {}\n").diagnostics
    assert (error.place.line, error.message) == (2, "the name has no ':' after it")


def test_players_sharing_a_key_message_names_key():
    loaded = read("strikes", "  bob: [{at: 1|1.05, play: knock}]\nstrikes")
    assert loaded.piece is not None
    (result,) = stage(loaded.piece).diagnostics
    assert "'knock' at 1|1.05 cuts 'knock' of 'ada' on key 'k'" in result.message
    assert result.help == "write `layer: true` to play both, or give each player a key"


def test_misplaced_comma_in_group_is_one_mistake():
    """`a: 4, 5s: 1` has a space: a mistake of another kind."""
    result = [d.code for d in read("tail: 4s", "tail: 4s, 5s: 1").diagnostics]
    assert result == ["E101"]


def test_melody_entry_with_to_mentions_field_of_entries():
    tap = "{tap: {at: 1|1, to: bell.hum, every: 1, times: 2, impulse: 1mNs}}"
    first, *_ = read(tap, "{tap: [{at: 1|1, to: bell.hum, impulse: 1mNs}]}").diagnostics
    assert (first.code, first.place.line) in (("E101", 11), ("E103", 11))
    unknown = [d for d in read(tap, "{tap: [{at: 1|1, to: bell.hum}]}").diagnostics if d.help]
    assert "an entry says `what` is struck" in (unknown[0].help or "")


@pytest.mark.parametrize(
    ("text", "code", "words", "suggestion"),
    [
        (
            "strikes: {h: {to: bell.all, at: 0, impulse: 1mNs}}",
            "E304",
            "write a list: [bell.a, bell.b]",
            None,
        ),
        ("gestures: {k: 0mm@0 \u22123mm@1}", "E204", "is not a position", "-3mm"),
        ("tempo: [{at: 0, bpm: 72..108, over: 4}]", "E204", "is not a tempo", "72 -> 108"),
        ("tempo: [{at: 0, bpm: 72 -> 80, over: 2 bars}]", "E204", "not a length", "2bars"),
        ("strikes: {h: {to: bell.a, at: [0, 1], impulse: 1mNs}}", "E106", "is a list", None),
        ("mix: {route: {from: bell, to: 1, gain: 0.5}}", "E203", "has no unit", "x0.5"),
    ],
)
def test_common_instrument_mistakes_have_one_message(text, code, words, suggestion):
    modules = "{a: {CEL: {M: 2g, f: 440Hz, t60: 1s}}, b: {CEL: {M: 2g, f: 550Hz, t60: 1s}}}"
    score = (
        f"ergon: 1\ninstruments: {{bell: {{modules: {modules}, out: {{SOX: [a, b]}}}}}}\n{text}\n"
    )
    (result,) = [d for d in load("s.yaml", text=score).diagnostics if d.code[0] == "E"]
    assert (result.code, result.suggestion) == (code, suggestion)
    assert words in result.message


def test_misspelt_required_field_has_one_message():
    """A field that is needed, and resembles an unknown one, is not missing too."""
    score = (
        "ergon: 1\nkeys: {k: {M: 400g, K: 60N/m}}\ngestures: {g: 0mm@0 3mm@1}\n"
        "players: {ada: {key: k}}\nparts: {ada: [{at: 0, pley: g}]}\n"
    )
    assert [(d.code, d.suggestion) for d in load("s.yaml", text=score).diagnostics] == [
        ("E101", "play")
    ]


def test_tempo_without_at_starts_at_beginning():
    first = load("s.yaml", text="ergon: 1\ntempo: {bpm: 72}\n").piece
    written = load("s.yaml", text="ergon: 1\ntempo: [{at: 1|1, bpm: 72}]\n").piece
    assert first is not None
    assert written is not None
    assert first.tempo_map.seconds(5.0) == written.tempo_map.seconds(5.0) == 5.0 * 60 / 72


@pytest.mark.parametrize(
    ("line", "suggestion", "help"),
    [
        (
            "mix: {layout: layouts/ring8.yaml}",
            "layouts/ring24.yaml",
            "in the library: layouts/dome24.yaml, layouts/dome8.yaml, layouts/ring24.yaml, "
            "layouts/stereo.yaml",
        ),
        ("use: [zzz.yaml]", None, None),
        ("use: [instruments/strin.yaml]", "instruments/string.yaml", None),
        ("use: [bels.yaml]", "instruments/bells.yaml", None),
        ("use: [gestures/x.yaml]", None, "in the library: gestures/common.yaml"),
        ("use: [instruments/mine/x.yaml]", None, None),
    ],
)
def test_missing_file_suggestions_and_help(line, suggestion, help):
    result = load("s.yaml", text=f"ergon: 1\n{line}\n").diagnostics
    (missing,) = [
        one for one in result if one.code in ("E107", "E112") and "no file" in one.message
    ]
    assert (missing.suggestion, missing.help) == (suggestion, help)


@pytest.mark.parametrize("name", ["gain bell", "bell.gain", "bell.hum.gain"])
def test_automation_of_level_suggests_route_fade(name):
    result = read("mix:", f"automation: [{{at: 1|1, set: {name}, to: -6dB, over: 2}}]\nmix:")
    (error,) = result.diagnostics
    assert error.place.line == 12
    assert "`fade` of its route" in (error.help or "")


FAMILY = """\
ergon: 1
instruments: {st: {from: string/string, notes: D3 minor count 8}}
strikes: {one: {to: TO, at: 0, notes: D3 F3 ~ D4, every: 1/2, times: 3, impulse: 1mNs}}
"""


@pytest.mark.parametrize(
    ("to", "message", "suggestion"),
    [
        ("st.hamer", "nothing is called 'st.hamer'", "st.hammer"),
        ("st.D3.hamer", "nothing is called 'st.D3.hamer'", "st.D3.hammer"),
        ("st.hammer.D3", "nothing is called 'st.hammer.D3'", None),
    ],
)
def test_misspelt_member_of_many_has_one_message(to, message, suggestion):
    (error,) = load("s.yaml", text=FAMILY.replace("TO", to)).diagnostics
    assert message in error.message
    assert error.suggestion == suggestion


@pytest.mark.parametrize(
    "tempo", ["{at: 1|1, bpm: 60, meter: 4/5}", "{at: 5|1, bpm: 60}, {at: 1|1}"]
)
def test_marks_known_despite_tempo_mistake(tempo):
    text = f"""\
ergon: 1
tempo: [{tempo}]
marks: {{A: 1|1, B: 3|1}}
let: {{first: 4}}
instruments: {{c: {{CEL: {{M: 1g, f: A4, t60: 0.5s}}, out: {{SOX: c}}}}}}
strikes: {{a: {{to: c, at: B, impulse: 1mNs}}, b: {{to: c, at: B - first, impulse: 1mNs}}}}
"""
    (error,) = load("s.yaml", text=text).diagnostics
    assert error.place.line == 2


def test_room_without_route_receives_all_channels():
    loaded = read(
        "mix: {channels: 1, route: [{from: bell, to: 1, gain: -6dB}]}",
        "mix: {rooms: {r: {t60: 1s}}}",
    )
    assert loaded.piece is not None, loaded.diagnostics


def test_missing_take_suggests_only_takes(tmp_path):
    (tmp_path / "hands.yaml").write_text("ergon: 1\n")
    path = tmp_path / "score.yaml"
    path.write_text("ergon: 1\ntakes: {h: {file: hand.csv}}\n")
    (error,) = load(path).diagnostics
    assert error.suggestion is None
    (tmp_path / "hands.csv").write_text("t [s],x [mm]\n0,0\n")
    (error,) = load(path).diagnostics
    assert error.suggestion == "hands.csv"


@pytest.mark.parametrize(
    ("points", "help"),
    [
        ("0mm@0 smooth 60mm@60ms 0mm@120ms", "write `do: [scale 0.2"),
        ("0mm@0 smooth 14.9mm@60ms 14mm@70ms 0mm@80ms", "write a `hold` at the turning point"),
    ],
)
def test_gesture_outside_travel_help(points, help):
    piece = read("0mm@0 smooth 6mm@60ms 0mm@120ms", points).piece
    assert piece is not None
    with pytest.raises(StageError) as raised:
        stage(piece)
    (error,) = (one for one in raised.value.diagnostics if one.code == "E307")
    assert error.help.startswith(help)


def test_notes_with_too_many_points_message_place(monkeypatch):
    monkeypatch.setattr("ergon.scores.staging.automating.MAX_POINTS", 10)
    text = """\
ergon: 1
instruments: {c: {CEL: {M: 1g, f: A4, t60: 0.5s}, out: {SOX: c}}}
strikes: {s: {to: c, at: 0, notes: A3 C4, every: 1/4, times: 60, impulse: 1uNs}}
"""
    piece = load("s.yaml", text=text).piece
    assert piece is not None
    with pytest.raises(StageError) as raised:
        stage(piece)
    (error,) = raised.value.diagnostics
    assert (error.code, error.place.line) == ("E105", 3)


PLAYED = """\
ergon: 1
instruments:
  vib:
    modules: {m: {CEL: {M: 2g, f: A3, t60: 2s}}}
    notes: [C3, E3]
    play: {strike: {at: m, impulse: 1mNs..4mNs}}
    out: {SOX: m}
strikes: {s: {to: vib.C3, at: 0, impulse: 1mNs}}
mix: {channels: 2, rooms: {hall: {t60: 2s}}, route: [{from: vib, to: 1, send: {hall: -6dB}}]}
tempo: {bpm: 96}
render: {file: out.wav}
"""


@pytest.mark.parametrize(
    ("old", "new", "line", "code", "words", "suggestion"),
    [
        # Clock times: both readings.
        ("at: 0", "at: 1:30", 8, "E204", "write 90s for 1 min 30 s, or 1|30 for beat 30", "90s"),
        ("at: 0", "at: 1:02:03", 8, "E204", "is a clock time: write 3723s", "3723s"),
        (
            "at: 0",
            "at: 0, times: 2, every: 0:45",
            8,
            "E204",
            "write a clock time in seconds",
            "45s",
        ),
        ("t60: 2s}}}", "t60: 0:02}}}", 4, "E201", "is a clock time; write it in seconds", "2s"),
        # Typeset characters.
        ("2g", "2\u00a0g", 4, "E201", "a no-break space (U+00A0); write a plain space", "2g"),
        ("M: 2g", "M:\u00a02g", 4, "E101", "unknown field", None),
        ("vib.C3, at", "vib\u202f.C3, at", 8, "E301", "nothing is called", "vib .C3"),
        ("at: 0", "at: 0, every: 2\u00a0bars, times: 2", 8, "E204", "a no-break space", "2bars"),
        (
            "[C3, E3]",
            "C3\u2013C4",
            5,
            "E201",
            "an en dash (U+2013); write '..'",
            "C3..C4",
        ),
        ("[C3, E3]", "C3\u2026C4", 5, "E201", "an ellipsis (U+2026); write two points", "C3..C4"),
        ("impulse: 1mNs}}", "impulse: p\u2026f}}", 8, "E201", "an ellipsis", "p..f"),
        ("impulse: 1mNs}}", "impulse: 1mNs\u20144mNs}}", 8, "E201", "an em dash", "1mNs..4mNs"),
        ("impulse: 1mNs}}", "impulse: 1\u20134mNs}}", 8, "E201", "an en dash", "1mNs..4mNs"),
        ("-6dB", "\u20136dB", 9, "E201", "'-' for a minus", "-6dB"),
        # Notes.
        ("A3", "A", 4, "E201", "'A' has no octave: write A3, A4 or another one", "A4"),
        ("A3", "bb", 4, "E201", "'bb' has no octave: write Bb3, Bb4", "Bb4"),
        ("A3", "La", 4, "E201", "'La' has no octave: write A3, A4", "A4"),
        ("A3", "sol#3", 4, "E201", "G#3, or G#4 where octaves are counted as in France", "G#3"),
        ("[C3, E3]", "[do3, mi3]", 5, "E201", "'do3' is solfège", "C3"),
        ("to: vib.C3", "to: vib, rhythm: c e, times: 2", 8, "E201", "'c' has no octave", "C4"),
        ("to: vib.C3", "to: vib, rhythm: c3 mi3, times: 2", 8, "E201", "is solfège", "E3"),
        ("to: vib.C3, at: 0", "to: vib, entries: 0 C", 8, "E201", "'C' has no octave", "C4"),
        # Values where a group is written.
        ("{bpm: 96}", "96", 10, "E106", "'tempo' is '96'; expected", "{bpm: 96}"),
        ("{bpm: 96}", "96 bpm", 10, "E106", "'tempo' is '96 bpm'", "{bpm: 96}"),
        ("{file: out.wav}", "out.wav", 11, "E106", "'render' is 'out.wav'", "{file: out.wav}"),
        ("tempo: {bpm: 96}", "tuning: 442Hz", 10, "E106", "is '442Hz'", "{A4: 442Hz}"),
        ("out.wav", "out.mp3", 11, "E201", "out.mp3 ends in .mp3, but sound files", "out.wav"),
        ("out.wav", "out", 11, "E201", "out has no ending, but sound files", "out.wav"),
        # What is refused is not missing too.
        ("t60: 2s}},", "t60: long}},", 9, "E201", "'long' is not a number", None),
        ("hall: -6dB", "hal: -6dB", 9, "E301", "no room is called 'hal'", "hall"),
        ("SOX", "SOXX", 7, "E101", "unknown output 'SOXX' of instrument 'vib'", "SOX"),
        ("SOX", "Soxx", 7, "E101", "unknown output 'Soxx' of instrument 'vib'", "SOX"),
    ],
)
def test_common_score_mistakes_have_one_message(old, new, line, code, words, suggestion):
    assert old in PLAYED
    text = PLAYED.replace(old, new, 1)
    (error,) = [d for d in load("s.yaml", text=text).diagnostics if d.severity == "error"]
    assert (error.code, error.place.line, error.suggestion) == (code, line, suggestion)
    assert words in error.message


@pytest.mark.parametrize(
    ("old", "new", "help"),
    [
        ("impulse: 1mNs}}", "impulse: 1mNs, pedal: down}}", "a score has no pedal: strokes of a"),
        ("impulse: 1mNs}}", "impulse: 1mNs, mute: true}}", "put '#' before their lines; at the"),
        ("to: 1,", "to: 1, mute: true,", "`gain: x0` there; at the prompt `mute bell`"),
        ("tempo:", "mute: [vib]\ntempo:", "an instrument is silent without its route"),
        (
            "tempo:",
            "phrases: {x: {entries: 0 C4, file: a.mid}}\ntempo:",
            "a file of notes is a take",
        ),
        ("M: 2g", "M:\u00a02g", "has a no-break space (U+00A0); write a plain space"),
    ],
)
def test_unknown_field_help_names_its_section(old, new, help):
    assert old in PLAYED
    text = PLAYED.replace(old, new, 1)
    (error,) = [d for d in load("s.yaml", text=text).diagnostics if d.severity == "error"]
    assert (error.code, error.suggestion) == ("E101", None)
    assert help in (error.help or "")


@pytest.mark.parametrize(
    ("text", "above", "word", "line"),
    [
        ("instruments:\nbell:\n  modules: {}\n", "instruments", "bell", 3),
        ("instruments:\n  bell:\n  modules:\n    m: {MAS: {M: 1g}}\n", "bell", "modules", 4),
        ("instruments:\n  bell:\n    modules:\n    m: {MAS: {M: 1g}}\n", "modules", "m", 5),
        ("mix:\nchannels: 2\nroute: []\n", "mix", "channels", 3),
        ("mix:\n  route:\n  from: bell\n  to: 1\n", "route", "from", 4),
        ("strikes:\n  s:\n  to: bell\n  at: 0\n", "s", "to", 4),
    ],
)
def test_lost_indentation_is_one_mistake(text, above, word, line):
    (error,) = load("s.yaml", text=f"ergon: 1\n{text}").diagnostics
    assert (error.code, error.place.line) == ("E101", line)
    assert error.message == f"nothing is written below '{above}', and '{word}' is beside it"
    assert error.help is not None
    assert error.help.startswith(f"put two more spaces before '{word}'")


@pytest.mark.parametrize(
    ("text", "suggestion"),
    [("marks:\ninstrumnts: {}\n", "instruments"), ("marks:\nplayer: {}\n", "players")],
)
def test_misspelt_section_after_empty_one(text, suggestion):
    (error,) = load("s.yaml", text=f"ergon: 1\n{text}").diagnostics
    assert error.suggestion == suggestion


@pytest.mark.parametrize(
    ("mark", "readings"),
    [("3.1", ("3|1", "3.1beats")), ("12.2", ("12|2", "12.2beats"))],
)
def test_mark_without_unit_lists_valid_forms(mark, readings):
    (result,) = load("s.yaml", text=f"ergon: 1\nmarks: {{B: {mark}}}\n").diagnostics
    assert result.code == "E203"
    assert result.suggestion == readings[0]
    for reading in readings:
        assert f"({reading})" in result.message
        assert not load("s.yaml", text=f"ergon: 1\nmarks: {{B: {reading}}}\n").diagnostics


def test_masses_of_discrete_networks_are_numbers():
    text = (
        "ergon: 1\ninstruments:\n  a: {units: ca, at: 44100Hz, modules: {s: {STRING: {masses: 5, "
        "M: 10, K: 0.1}}}, out: {SOX: s.2}}\n"
    )
    assert not [d for d in load("s.yaml", text=text).diagnostics if d.severity == "error"]
    in_si = text.replace("units: ca, at: 44100Hz, ", "").replace("K: 0.1", "f: A3")
    assert [d.code for d in load("s.yaml", text=in_si).diagnostics] == ["E203"]


def test_do_of_an_instrument_without_notes_is_refused():
    score = read("every: 1, times: 2", "every: 1, notes: C4 E4, do: rev")
    (mistake,) = (one for one in score.diagnostics if one.code == "E306")
    assert "and 'bell' has none; give it some, such as `notes: C3..C5`" in mistake.message


@pytest.mark.parametrize("rest", ["ply 2", "G4"])
def test_value_cut_by_a_comma_is_quoted(rest: str):
    cut = read("every: 1, times: 2", f"every: 1, notes: C4 E4, {rest}")
    (mistake,) = (one for one in cut.diagnostics if one.code == "E101")
    advice = "a comma ends a value between braces; write it in quotes: "
    assert mistake.help == f'{advice}notes: "C4 E4, {rest}"'


@pytest.mark.parametrize(
    ("text", "help"),
    [
        ("skins/block", "the library has found/block"),
        ("block", "the library has found/block"),
        ("drums/block", "the library has found/block"),
        ("skins/blok", "known here: timpani"),
    ],
)
def test_load_with_instrument_of_another_family(text: str, help: str):
    score = f"ergon: 1\ninstruments:\n  wood: {{from: {text}}}\n"
    errors = [d for d in load("s.yaml", text=score).diagnostics if d.code == "E301"]
    assert [error.place.line for error in errors] == [3]
    assert (errors[0].help or "").startswith(help)


def test_load_with_name_without_indentation():
    """Both readings: a section that it resembles, and a name of a section's own."""
    text = "ergon: 1\ninstruments:\n  vib: {from: bars/vibraphone}\nmar: {from: bars/marimba}\n"
    (error,) = [d for d in load("s.yaml", text=text).diagnostics if d.severity == "error"]
    assert (error.code, error.place.line, error.suggestion) == ("E101", 4, "marks")
    assert "stands indented in its section" in (error.help or "")


def test_load_with_a_no_break_space_before_an_instrument():
    """The blank is named where it stands, some lines before the error of the parser."""
    text = "ergon: 1\ninstruments:\n\u00a0 vib:\n    from: bars/vibraphone\n    at: 1Hz\n  b: {}\n"
    (error,) = [d for d in load("s.yaml", text=text).diagnostics if d.severity == "error"]
    assert (error.code, error.place.line, error.place.column) == ("E100", 3, 1)
    assert "a no-break space (U+00A0)" in error.message
