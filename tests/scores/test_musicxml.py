"""Notes, dynamics, tempos, meters and repeats of MusicXML files."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest

from ergon.scores.gesture.musicxml_file import meters_of, part_notes, read_score, tempos_of
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage
from ergon.scores.staging.struck_notes import struck_notes

HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<!DOCTYPE score-partwise PUBLIC "-//Recordare//DTD MusicXML 4.0 Partwise//EN"
  "http://www.musicxml.org/dtds/partwise.dtd">
"""


def note(step: str, octave: int, duration: int, more: str = "", alter: str = "") -> str:
    sign = f"<alter>{alter}</alter>" if alter else ""
    pitch = f"<pitch><step>{step}</step>{sign}<octave>{octave}</octave></pitch>"
    return f"<note>{pitch}<duration>{duration}</duration><voice>1</voice>{more}</note>"


def part(*measures: str, name: str = "P1") -> str:
    attributes = "<attributes><divisions>2</divisions><time><beats>4</beats>"
    first = f"{attributes}<beat-type>4</beat-type></time></attributes>{measures[0]}"
    texts = (
        f'<measure number="{number}">{text}</measure>'
        for number, text in enumerate((first, *measures[1:]), 1)
    )
    return f'<part id="{name}">{"".join(texts)}</part>'


def written(folder: Path, *parts: str, head: str = HEAD, name: str = "tune.musicxml") -> Path:
    names = "".join(
        f'<score-part id="P{n}"><part-name>Voice {n}</part-name></score-part>'
        for n in range(1, len(parts) + 1)
    )
    path = folder / name
    text = f"{head}<score-partwise><part-list>{names}</part-list>{''.join(parts)}</score-partwise>"
    path.write_text(text, encoding="utf-8")
    return path


def played(path: Path) -> list[tuple[float, str, float]]:
    return [(n.at, n.word, n.length) for n in part_notes(path, None)[0]]


def test_chords_voices_and_spelling(tmp_path):
    chord = "<chord/>"
    second = note("E", 3, 8).replace("<voice>1", "<voice>2")
    measure = note("C", 4, 4) + note("E", 4, 4).replace("<note>", f"<note>{chord}")
    measure += note("B", 4, 4, alter="-1") + "<backup><duration>8</duration></backup>" + second
    assert played(written(tmp_path, part(measure))) == [
        (0.0, "E3", 4.0),
        (0.0, "C4", 2.0),
        (0.0, "E4", 2.0),
        (2.0, "Bb4", 2.0),
    ]


def test_quarter_tones_and_transposing_instruments(tmp_path):
    clarinet = "<attributes><transpose><diatonic>-1</diatonic><chromatic>-2</chromatic>"
    clarinet += "</transpose></attributes>"
    measure = clarinet + note("C", 5, 4) + note("F", 5, 2, alter="1") + note("D", 5, 2, alter="0.5")
    assert [word for _, word, _ in played(written(tmp_path, part(measure)))] == [
        "Bb4",
        "E5",
        "C5+50cents",
    ]


@pytest.mark.parametrize("stop", ['<tie type="stop"/>', ""])
def test_ties_over_the_bar_line(tmp_path, stop):
    tie = '<tie type="start"/>'
    path = written(tmp_path, part(note("C", 4, 8, tie), note("C", 4, 2, stop) + note("C", 4, 6)))
    assert played(path) == [(0.0, "C4", 5.0), (5.0, "C4", 3.0)]


def repeat(direction: str, times: str = "") -> str:
    return f'<barline><repeat direction="{direction}"{times}/></barline>'


def ending(number: str, kind: str) -> str:
    return f'<barline><ending number="{number}" type="{kind}"/></barline>'


A, B, C, D, E = (note(step, 4, 8) for step in "ABCDE")


@pytest.mark.parametrize(
    ("measures", "order"),
    [
        ([A, B + repeat("backward"), C], "ABABC"),
        ([A, repeat("forward") + B, C + repeat("backward"), D], "ABCBCD"),
        ([A + repeat("backward", ' times="3"'), B], "AAAB"),
        (
            [
                A,
                ending("1", "start") + B + ending("1", "stop") + repeat("backward"),
                ending("2", "start") + C + ending("2", "discontinue"),
                D + repeat("backward"),
                E,
            ],
            "ABACDDE",
        ),
        (
            [
                A,
                ending("1, 2", "start") + B + ending("1, 2", "stop") + repeat("backward"),
                ending("3", "start") + C + ending("3", "stop"),
                D,
            ],
            "ABABACD",
        ),
        ([A, B + '<sound fine="yes"/>', C + '<sound dacapo="yes"/>'], "ABCAB"),
        (
            [
                A,
                '<sound segno="s"/>' + B + '<sound tocoda="c"/>',
                C + '<sound dalsegno="s"/>',
                '<sound coda="c"/>' + D,
            ],
            "ABCBD",
        ),
        (
            [
                A,
                ending("1", "start") + B + ending("1", "stop") + repeat("backward"),
                ending("2", "start") + C + ending("2", "stop") + '<sound dacapo="yes"/>',
                D,
            ],
            "ABACACD",
        ),
    ],
)
def test_repeats_endings_and_jumps(tmp_path, measures, order):
    notes = played(written(tmp_path, part(*measures)))
    assert "".join(word[0] for _, word, _ in notes) == order
    assert [at for at, _, _ in notes] == [4.0 * n for n in range(len(order))]


def direction(kind: str, more: str = "") -> str:
    return f"<direction><direction-type>{kind}</direction-type>{more}</direction>"


def mark(word: str) -> str:
    return direction(f"<dynamics><{word}/></dynamics>")


def wedge(kind: str) -> str:
    return direction(f'<wedge type="{kind}"/>')


def strengths(path: Path) -> list[float | None]:
    return [n.strength and round(7 * n.strength, 6) for n in part_notes(path, None)[0]]


def test_dynamics_and_hairpins(tmp_path):
    four = [note(step, 4, 2) for step in "CDEF"]
    first = four[0] + mark("p") + "".join(four[1:])
    second = wedge("crescendo") + "".join(four) + wedge("stop")
    third = mark("ff") + four[0] + four[1] + wedge("diminuendo") + four[2] + four[3] + wedge("stop")
    path = written(tmp_path, part(first, second, third, four[0]))
    # p is step 2 of 7, ff step 6; a hairpin to no mark goes by one step.
    assert strengths(path) == [None, 2, 2, 2, 2, 3, 4, 5, 6, 6, 6, 5.5, 5]


def test_accents_sforzati_and_fortepiano(tmp_path):
    accent = "<notations><articulations><accent/></articulations></notations>"
    measure = mark("mf") + note("C", 4, 2, accent) + note("C", 4, 2) + mark("sfz")
    measure += note("D", 4, 2) + note("E", 4, 2)
    path = written(tmp_path, part(measure, mark("fp") + note("C", 4, 4) + note("D", 4, 4)))
    assert strengths(path) == [5, 4, 5, 4, 5, 2]


def test_tempos_and_meters_in_quarters(tmp_path):
    metronome = "<metronome><beat-unit>quarter</beat-unit><beat-unit-dot/>"
    metronome = direction(f"{metronome}<per-minute>60</per-minute></metronome>")
    time = "<attributes><time><beats>3+2</beats><beat-type>8</beat-type></time></attributes>"
    first = '<sound tempo="84"/>' + note("C", 4, 8)
    path = written(tmp_path, part(first, time + metronome + note("D", 4, 5)))
    assert tempos_of(path) == ((0.0, 84.0), (4.0, 90.0))
    assert [(at, str(meter)) for at, meter in meters_of(path)] == [(0.0, "4/4"), (4.0, "3+2/8")]


def test_meters_with_an_upbeat(tmp_path):
    text = part(note("G", 4, 2), note("C", 5, 8)).replace(
        '<measure number="1">', '<measure number="0" implicit="yes">'
    )
    assert played(written(tmp_path, text)) == [(3.0, "G4", 1.0), (4.0, "C5", 4.0)]


def test_meters_with_an_incomplete_bar(tmp_path):
    path = written(tmp_path, part(note("C", 4, 8), note("D", 4, 4), note("E", 4, 8), B))
    texts = [(at, str(meter)) for at, meter in meters_of(path)]
    assert texts == [(0.0, "4/4"), (4.0, "2/4"), (6.0, "4/4")]


def test_grace_notes_before_the_beat(tmp_path):
    grace = note("D", 5, 0).replace("<note>", "<note><grace/>")
    grace = grace.replace("<duration>0</duration>", "")
    path = written(tmp_path, part(note("C", 5, 4) + grace + note("E", 5, 4)))
    assert played(path) == [(0.0, "C5", 2.0), (2.0 - 1 / 12, "D5", 1 / 12), (2.0, "E5", 2.0)]


def test_counts_of_unplayed_elements(tmp_path):
    drum = "<note><unpitched/><duration>2</duration></note>"
    trill = note("C", 4, 2, "<notations><ornaments><trill-mark/></ornaments></notations>")
    score = read_score(written(tmp_path, part(drum + trill + direction("<words>rit.</words>"))))
    counts = {noun: count for noun, count in score.skipped_counts.items() if count}
    assert counts == {"unpitched note": 1, "ornament": 1, "direction": 1}


def test_compressed_utf_16_and_timewise_files(tmp_path):
    plain = written(tmp_path, part(A, B), part(C, D, name="P2"))
    text = plain.read_text(encoding="utf-8")
    wide = tmp_path / "wide.xml"
    wide.write_bytes(text.replace("UTF-8", "UTF-16").encode("utf-16"))
    container = '<container><rootfiles><rootfile full-path="a/b.xml"/></rootfiles></container>'
    packed = tmp_path / "tune.mxl"
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("META-INF/container.xml", container)
        file.writestr("a/b.xml", text)
    attributes = part(A).partition("<measure")[2].partition(">")[2].partition("<note")[0]
    turned = "<part-list><score-part id='P1'/></part-list>"
    for item, two, head in ((A, C, attributes), (B, D, "")):
        turned += f"<measure><part id='P1'>{head}{item}</part><part id='P2'>{head}{two}</part>"
        turned += "</measure>"
    by_measure = tmp_path / "timewise.xml"
    by_measure.write_text(f"<score-timewise>{turned}</score-timewise>", encoding="utf-8")
    expected = played(plain)
    assert expected[:2] == [(0.0, "C4", 4.0), (0.0, "A4", 4.0)]
    for path in (wide, packed, by_measure):
        assert played(path) == expected, path.name


def bomb() -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("score.xml", b" " * (17 << 20))
    return data.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty|not well formed"),
        (b"PK\x03\x04 no archive", "zip"),
        (b"<score-partwise><part>", "not well formed"),
        (b"<html/>", "its root is html"),
        (b"<score-partwise/>", "no notes"),
        (b'<!DOCTYPE x [<!ENTITY a "b">]><score-partwise/>', "document type"),
        (b"\xff\xfe\x00", "UTF-16"),
        (bomb(), "more than 16 MB"),
    ],
)
def test_hostile_musicxml_files(tmp_path, content, words):
    path = tmp_path / "tune.xml"
    path.write_bytes(content)
    with pytest.raises(TakeError, match=f"(?i){words}"):
        part_notes(path, None)


def test_missing_part_of_musicxml(tmp_path):
    path = written(tmp_path, part(A), part(B, name="P2"))
    assert [n.word for n in part_notes(path, "Voice 2")[0]] == ["B4"]
    with pytest.raises(TakeError, match=r"part P7 is not there; .* P1 \(Voice 1\), P2"):
        part_notes(path, "P7")


SCORE = """\
ergon: 1
tempo: [{from: tune.musicxml}]
meter: {from: tune.musicxml}
takes: {tune: {file: tune.musicxml, channel: P1}}
instruments:
  cell:
    modules: {m: {CEL: {M: 1g, f: C4, t60: 1s}}}
    notes: C4..C5
    play: {strike: {at: m, impulse: 1mNs..100mNs}}
    out: {SOX: m}
strikes: {melody: {play: tune, to: cell, at: 1|1}}
render: {tail: 1s}
"""


def test_score_with_musicxml_take(tmp_path):
    first = '<sound tempo="60"/>' + mark("ppp") + note("C", 4, 4) + mark("fff") + note("E", 4, 4)
    written(tmp_path, part(first, note("G", 4, 8)), part(B, name="P2"))
    result = load(tmp_path / "score.yaml", text=SCORE)
    assert [d.code for d in result.diagnostics if d.code != "W325"] == []
    notes = struck_notes(stage(result.piece))
    listened = [(n.member, round(n.begin, 9), round(n.strength, 9)) for n in notes]
    assert listened == [("cell.C4", 0.0, 0.0), ("cell.E4", 2.0, 1.0), ("cell.G4", 4.0, 1.0)]


REST = "<note><rest/><duration>{}</duration><voice>1</voice></note>"


def test_musicxml_rests_longer_than_bar(tmp_path):
    """Programs write two whole rests, or one of a breve, where the other parts have a bar."""
    melody = part(note("C", 4, 8), note("D", 4, 8), note("E", 4, 8))
    silent = part(REST.format(8), REST.format(8) * 2, note("G", 3, 8), name="P2")
    path = written(tmp_path, melody, silent)
    assert played(path) == [(0.0, "C4", 4.0), (4.0, "D4", 4.0), (8.0, "G3", 4.0), (8.0, "E4", 4.0)]


def test_musicxml_rests_in_incomplete_bar(tmp_path):
    """A bar that counts for nothing (`implicit`) is as long as its shortest part."""
    upbeat = part(note("C", 4, 8), note("D", 4, 2), note("E", 4, 8))
    silent = part(REST.format(8), REST.format(8), note("G", 3, 8), name="P2")
    marked = [text.replace('number="2"', 'number="X1" implicit="yes"') for text in (upbeat, silent)]
    path = written(tmp_path, *marked)
    assert played(path) == [(0.0, "C4", 4.0), (4.0, "D4", 1.0), (5.0, "G3", 4.0), (5.0, "E4", 4.0)]


def test_length_of_a_bar_of_rests(tmp_path):
    path = written(tmp_path, part(note("C", 4, 8), REST.format(12), note("E", 4, 8)))
    assert played(path) == [(0.0, "C4", 4.0), (10.0, "E4", 4.0)]
