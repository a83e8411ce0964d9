"""`ergon lsp` as an editor meets it: a process, and a session of the protocol."""

from collections.abc import Awaitable, Callable
from pathlib import Path
from urllib.parse import urlparse
from urllib.request import url2pathname

import midi_files
import pytest
from lsp_editor import Editor, in_editor
from lsprotocol import types as t

SCORE = """\
ergon: 1
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: A3, t60: 2s}}
      b: {BUT: {between: [k, m], K: 4kN/m, gap: 1mm}}
    out: {SOX: m}
gestures:
  knock: 0mm@0 smooth 6mm@1/8 0mm@1/2
marks: {B: 5|1}
players: {ada: {key: k}}
parts:
  ada:
    - {at: 0, play: knock, times: 2}
mix: {route: [{from: bell, to: 1}]}
"""


@pytest.fixture
def session(tmp_path: Path) -> Callable[[str, Callable[[Editor], Awaitable[None]]], None]:
    """Open a score in an editor, and do something there."""

    def run(score: str, act: Callable[[Editor], Awaitable[None]]) -> None:
        path = tmp_path / "score.yaml"
        path.write_text(score, encoding="utf-8")
        in_editor(path, act)

    return run


def test_diagnostics_and_fix_while_typing(session):
    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        editor.type(editor.text.replace("play: knock", "play: knok"))
        [wrong] = await editor.diagnostics(bool)
        assert wrong.code == "E301"
        assert wrong.code_description is not None
        page = Path(url2pathname(urlparse(wrong.code_description.href).path))
        assert page.read_text(encoding="utf-8").startswith("# E301")
        assert wrong.severity == t.DiagnosticSeverity.Error
        assert (wrong.range.start.line, wrong.range.start.character) == (14, 20)
        assert wrong.range.end.character == 24
        params = t.CodeActionParams(
            t.TextDocumentIdentifier(editor.uri), wrong.range, t.CodeActionContext([wrong])
        )
        actions = await editor.client.text_document_code_action_async(params)
        assert actions is not None
        [action] = actions
        assert isinstance(action, t.CodeAction)
        assert action.edit is not None
        assert action.edit.changes is not None
        [edit] = action.edit.changes[editor.uri]
        assert (edit.new_text, edit.range) == ("knock", wrong.range)
        editor.type(editor.text.replace("play: knok", "play: knock"))
        await editor.diagnostics(lambda found: not found)

    session(SCORE, act)


def test_diagnostic_columns_in_utf16_units(session):
    # U+1D11E takes two UTF-16 units, and one character of the checker's.
    async def act(editor: Editor) -> None:
        result = await editor.diagnostics(bool)
        assert result[-1].range.start == editor.position_after("nott: 1, ")
        assert result[-1].range.end == editor.position_after("nott: 1, nope")

    session(SCORE.replace("{key: k}", '{key: k, "\U0001d11e": 2, nott: 1, nope: 2}'), act)


def test_names_fields_notes_and_units_are_completed(session):
    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        editor.type(editor.text.replace("times: 2}", "times: 2, }").replace("t60: 2s", "t60: 2"))
        assert "knock" in await editor.completed("play: ")
        fields = await editor.completed("times: 2, ")
        assert {"every", "do", "until"} <= set(fields)
        assert not {"at", "play", "times"} & set(fields)
        assert "repetitions" in (fields["every"].detail or "")
        assert set(await editor.completed("ada: {key: ")) == {"k"}
        assert "A3" in await editor.completed("f: ")
        assert {"2s", "2ms"} <= set(await editor.completed("t60: 2"))
        assert {"CEL", "MAS", "STRING"} <= set(await editor.completed("      m: {"))
        kinds = await editor.completed("  bell:\n    ")
        assert "like" in kinds
        assert "out" not in kinds

    session(SCORE, act)


def test_modules_of_a_loop_are_completed_and_explained(session):
    loop = """\
      for i in 1..4:
        if i > 1:
          r(i): {REF: {between: [q(i-1), q(i)], K: 1kN/m, Z: 0Ns/m}}
        q(i): {MAS: {M: 2g}}
"""
    score = SCORE.replace("    out: {SOX: m}\n", loop + "    out: {SOX: m}\n")

    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        assert "mass" in await editor.hovered("q(i): {MAS: {")
        editor.type(editor.text.replace("{MAS: {M: 2g}}", "{MAS: {M: 2}}"))
        assert {"2g", "2kg"} <= set(await editor.completed("{MAS: {M: 2"))
        assert {"CEL", "MAS", "REF"} <= set(await editor.completed("q(i): {"))
        editor.type(editor.text.replace("Z: 0Ns/m", "Z: 0Ns/m, "))
        assert "rest" in await editor.completed("Z: 0Ns/m, ")

    session(score, act)


def test_completion_in_invalid_yaml_line(session):
    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        editor.type(SCORE.replace("mix: {route: [{from: bell, to: 1}]}", "mix: {route: [{from: be"))
        assert set(await editor.completed("{from: be")) == {"bell"}
        editor.type(SCORE + "acc")
        words = await editor.completed("acc")
        assert "accuracy" in words
        edit = words["accuracy"].text_edit
        assert isinstance(edit, t.TextEdit)
        assert edit.new_text == "accuracy: "
        assert edit.range.start.character == 0

    session(SCORE, act)


def test_completion_and_definition_in_table_of_part(session):
    table = SCORE.replace(
        "\n    - {at: 0, play: knock, times: 2}", " |\n    0  knock every 1 times 2"
    )

    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        words = await editor.completed("    0  kn")
        assert {"knock", "B", "every", "times"} <= set(words)
        place = await editor.defined("    0  kn")
        assert place.range.start.line == 9

    session(table, act)


def test_hover_of_fields_notes_and_gestures(session):
    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        assert "decay" in await editor.hovered("t6")
        assert "220.000 Hz" in await editor.hovered("f: A")
        assert "knock: 0mm@0 smooth" in await editor.hovered("play: kn")
        assert "contact" in await editor.hovered("{BU")

    session(SCORE, act)


TUNED = """\
ergon: 1
tuning: {edo: 31}
instruments:
  wires:
    f: E4
    modules: {m: {CEL: {M: 2g, f: C#4, t60: 2s}}}
    notes: [C4, A4+50cents, 3/2]
    play: {strike: {at: m, impulse: 1mNs..4mNs}}
    out: {SOX: m}
strikes:
  s: {to: wires.3/2.m, at: 3/2, impulse: 1mNs}
  r: {rhythm: "c4:f a4+50cents", to: wires, at: 0, times: 1}
"""


def test_notes_of_a_tuning_are_explained_in_hertz(session):
    c4 = 440.0 * 2.0 ** (-23 / 31)
    expected = {
        "f: E": c4 * 2.0 ** (10 / 31),
        "f: C": c4 * 2.0 ** (2 / 31),
        "[C4, A4": 440.0 * 2.0 ** (50 / 1200),
        "50cents, 3": 1.5 * c4,
        "to: wires.3": 1.5 * c4,
        '"c': c4,
        '"c4:f a4+50': 440.0 * 2.0 ** (50 / 1200),
    }

    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        for before, hertz in expected.items():
            assert f"{hertz:.3f} Hz" in await editor.hovered(before), before
        assert (await editor.hovered("50cents, 3")).endswith("Hz, G4 +11.6 cents")
        assert "Hz" not in await editor.hovered("{edo")
        assert (await editor.completed("f: C"))["E4"].detail == f"{expected['f: E']:.2f} Hz"

    session(TUNED, act)


def test_notes_of_an_instrument_are_explained_in_its_tuning(session):
    text = TUNED.replace("  wires:", "  wires:\n    tuning: {edo: 19}")
    c4 = 440.0 * 2.0 ** (-14 / 19)
    expected = {"f: E": c4 * 2.0 ** (6 / 19), "50cents, 3": 1.5 * c4, "to: wires.3": 1.5 * c4}

    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        for before, hertz in expected.items():
            assert f"{hertz:.3f} Hz" in await editor.hovered(before), before

    session(text, act)


def test_tempos_and_meters_of_midi_file_are_known(session, tmp_path: Path):
    midi_files.save(tmp_path / "tune.mid", [midi_files.meter(0, 6, 8)], midi_files.note(0))
    text = "ergon: 1\ntempo: {from: tune.mid}\nmeter: {from: tune.mid}\n"

    async def act(editor: Editor) -> None:
        [note] = await editor.diagnostics(bool)
        assert (note.code, note.severity) == ("N404", t.DiagnosticSeverity.Information)
        assert note.message.startswith(
            "tune.mid: the score does not use 1 note of channel 1 of this file"
        )
        assert "a MIDI or MusicXML file whose tempos hold" in await editor.hovered("tempo: {fr")
        assert "a MIDI or MusicXML file whose meters hold" in await editor.hovered("meter: {fr")
        assert "from" in await editor.completed("meter: {")

    session(text, act)


def test_definition_in_score_and_used_file(session, tmp_path: Path):
    (tmp_path / "other.yaml").write_text("ergon: 1\ngestures: {lean: 0mm@0 3mm@1}\n")
    score = SCORE.replace("gestures:", "use: other.yaml\ngestures:").replace(
        "times: 2}", "times: 2}\n    - {at: 3, play: lean}"
    )

    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        module = await editor.defined("between: [k, m")
        assert (module.uri, module.range.start.line) == (editor.uri, 5)
        leaning_gesture = await editor.defined("play: le")
        assert leaning_gesture.uri == (tmp_path / "other.yaml").as_uri()
        assert leaning_gesture.range.start == t.Position(1, 11)

    session(score, act)


def test_engine_diagnostics_at_opening_of_score(session):
    stiff = SCORE.replace("K: 4kN/m, gap", "K: 4e12N/m, gap") + "accuracy: {method: ca}\n"

    async def act(editor: Editor) -> None:
        found = await editor.diagnostics(bool)
        assert found[0].severity == t.DiagnosticSeverity.Error

    session(stiff, act)


def test_document_symbols_and_formatting(session):
    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        document = t.TextDocumentIdentifier(editor.uri)
        symbols = await editor.client.text_document_document_symbol_async(
            t.DocumentSymbolParams(document)
        )
        assert symbols is not None
        names = {
            item.name: [inner.name for inner in item.children or ()]
            for item in symbols
            if isinstance(item, t.DocumentSymbol)
        }
        assert names["gestures"] == ["knock"]
        editor.type(SCORE.replace("{at: 0, play", "{at:   0,   play"))
        params = t.DocumentFormattingParams(document, t.FormattingOptions(2, True))
        edits = await editor.client.text_document_formatting_async(params)
        assert edits is not None
        assert edits[0].new_text == SCORE

    session(SCORE, act)


def test_foreign_yaml_gets_no_diagnostics_or_completion(session):
    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        editor.type("services:\n  web: {image: x}\n")
        assert not await editor.completed("services")
        editor.type("ergon: 1\nservices:\n  web: {image: x}\n")
        [wrong] = await editor.diagnostics(bool)
        assert "unknown section 'services'" in wrong.message

    session("services:\n  web: {image: x}\n", act)


PLAYED = """\
ergon: 1
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bar:
    modules: {m: {CEL: {M: 2g, f: A4, t60: 2s}}, w: {SOL: {}}}
    play:
      bow:
        draw: hair 0.1m/s..1m/s
        with: {hair: {LNL: {between: [w, m], damping: bow}}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@1/8 0mm@1/2}
players: {ada: {key: k}}
parts:
  ada:
    - {at: 0, play: knock, every: 1, times: 8, do: "every 4 rev, degrade 0.3"}
strikes:
  s: {rhythm: "bar:mf ~", at: 0, times: 2, do: "off 1/8 scale 0.5"}
  r: {to: bar, at: 0, impulse: ff}
"""


def test_words_of_playing_are_completed_and_explained(session):
    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        hands = await editor.completed('do: "every 4 re')
        assert {"rev", "degrade", "mirror", "whenmod", "stretch"} <= set(hands)
        assert "off" not in hands
        rhythms = await editor.completed('do: "off 1/8 sc')
        assert {"off", "ply", "legato", "arp", "transpose", "every"} <= set(rhythms)
        assert "stronger by a factor" in rhythms["scale"].detail
        assert {"mf", "bar"} <= set(await editor.completed('rhythm: "ba'))
        assert "fff" in await editor.completed("impulse: f")
        assert {"press", "until", "turns", "release"} <= set(await editor.completed("        dr"))
        assert "first of every so many rounds" in await editor.hovered('do: "eve')
        assert "without" in await editor.hovered("rev, degr")
        assert "together with a changed copy" in await editor.hovered('do: "of')
        assert "strength 4/7" in await editor.hovered("bar:m")
        assert "strength 6/7" in await editor.hovered("impulse: f")
        assert "how fast a link rubs" in await editor.hovered("        dr")

    session(PLAYED, act)


def test_table_of_part_has_words_of_hands(session):
    rows = PLAYED.replace(
        '\n    - {at: 0, play: knock, every: 1, times: 8, do: "every 4 rev, degrade 0.3"}',
        " |\n    0  knock every 1 times 8 do every 4 rev, degrade 0.3",
    )

    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda found: not found)
        assert {"rev", "degrade", "often"} <= set(await editor.completed("times 8 do every 4 r"))
        assert "such as rev" in await editor.hovered("do every 4 re")

    session(rows, act)
