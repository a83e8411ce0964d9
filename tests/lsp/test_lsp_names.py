"""Names in an editor: renamed wherever they stand, and parts of MusicXML for `channel`."""

from __future__ import annotations

from pathlib import Path

import pytest
from lsp_editor import Editor, in_editor
from pygls.exceptions import JsonRpcException

PHRASES = """\
ergon: 1
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 2s}, notes: C3..C5, play: {strike: {impulse: 0.1mNs..2mNs}}, out: {SOX: cell}}
phrases:
  # \U0001d11e a turn
  turn: {to: cell, entries: [{at: 0, what: C4}, {at: 1, what: E4}]}
  back: {like: turn, do: [reverse]}
  line:
    to: cell
    length: 8
    entries: |
      # at  what
      0     turn  mf
      2     G4
      3     back
      5     turn
  hook: {to: cell, entries: [{at: 0, what: line}, {at: 8, what: [turn]}]}
strikes:
  song: {play: line, at: 1|1}
  turned: {play: turn, at: 9|1}
  # turn is a word of this comment
"""  # noqa: E501

MUSIC = """\
<score-partwise><part-list>
<score-part id="P1"><part-name>Flute I</part-name></score-part>
<score-part id="P2"><part-name>Horn</part-name></score-part></part-list>
<part id="P1"><measure number="1"><attributes><divisions>1</divisions></attributes>
<note><pitch><step>C</step><octave>4</octave></pitch><duration>4</duration></note></measure></part>
<part id="P2"><measure number="1"><attributes><divisions>1</divisions></attributes>
<note><pitch><step>E</step><octave>3</octave></pitch><duration>2</duration></note>
<note><pitch><step>G</step><octave>3</octave></pitch><duration>2</duration></note></measure></part>
</score-partwise>
"""
TAKES = """\
ergon: 1
instruments:
  cell: {CEL: {M: 1g, f: A4, t60: 2s}, notes: C3..C5, play: {strike: {impulse: 0.1mNs..2mNs}}, out: {SOX: cell}}
takes:
  horn: {file: tune.musicxml, channel: P2}
strikes:
  song: {play: horn, to: cell, at: 1|1}
"""  # noqa: E501


@pytest.fixture
def score(tmp_path: Path):
    def put(text: str) -> Path:
        path = tmp_path / "score.yaml"
        path.write_text(text, encoding="utf-8")
        (tmp_path / "tune.musicxml").write_text(MUSIC)
        return path

    return put


def test_rename_of_phrase_from_every_use(score):
    expected = PHRASES.replace("turn", "gruppetto").replace("gruppettoed", "turned")
    for comment in ("a turn", "# turn is"):
        expected = expected.replace(comment.replace("turn", "gruppetto"), comment)

    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda reported: not reported)
        for where in ("  tu", "0     tu", "like: tu", "{play: tu"):
            assert await editor.renamed(where, "gruppetto") == expected

    in_editor(score(PHRASES), act)


def test_rename_refused_by_the_language_server(score):
    async def act(editor: Editor) -> None:
        await editor.diagnostics(lambda reported: not reported)
        for where, new, message in (
            ("  tu", "line", "the name 'line' is in use"),
            ("  tu", "a b", "'a b' is not a name"),
            ("ergo", "x", "is written in a file that the score uses"),
        ):
            with pytest.raises(JsonRpcException, match=message):
                await editor.renamed(where, new)
        editor.type(editor.text.replace("play: line", "play: lin"))
        await editor.diagnostics(bool)
        with pytest.raises(JsonRpcException, match="the score has mistakes"):
            await editor.renamed("  tu", "x")

    in_editor(score(PHRASES), act)


def test_parts_of_musicxml_are_completed_and_explained(score):
    async def act(editor: Editor) -> None:
        await editor.diagnostics(bool)  # the meter of the file is passed over
        offered = await editor.completed("channel: ")
        assert offered["P1"].detail == "part P1 (Flute I): 1 note"
        assert offered["P2"].detail == "part P2 (Horn): 2 notes"
        assert "part P2 (Horn): 2 notes" in await editor.hovered("channel: P")

    in_editor(score(TAKES), act)


def test_completion_of_parts_of_unreadable_files(score):
    async def act(editor: Editor) -> None:
        await editor.diagnostics(bool)
        for file in ("../tune.musicxml", "none.musicxml", "score.yaml"):
            editor.type(TAKES.replace("tune.musicxml", file))
            await editor.diagnostics(bool)
            assert "P1" not in await editor.completed("channel: ")

    in_editor(score(TAKES), act)
