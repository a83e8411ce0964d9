"""Scores of MusicXML as other programs write them, beside the notes that were written."""

from __future__ import annotations

import io
import random
import zipfile
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import pytest

from ergon.scores.gesture.musicxml_file import part_notes, read_score
from ergon.scores.gesture.take_file import TakeError

_GRACE = Fraction(1, 12)


class Note(NamedTuple):
    """What is to be read: quarters, a name, a length in quarters."""

    begin: Fraction
    word: str
    lasting: Fraction


class Writer:
    """Random parts of whole bars, in the forms that programs choose."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.n_bars = self.chance.randrange(1, 5)
        self.notes: list[Note] = []
        self.root = Element("score-partwise", version=self.chance.choice(["1.0", "3.1", "4.0"]))
        listed = SubElement(self.root, "part-list")
        for number in range(1, self.chance.randrange(2, 4)):
            name = f"P{number}"
            SubElement(SubElement(listed, "score-part", id=name), "part-name").text = "Flöte"
            self._part(SubElement(self.root, "part", id=name))

    def _part(self, part: Element) -> None:
        divisions = 1
        for bar in range(self.n_bars):
            measure = SubElement(part, "measure", number=str(bar + 1))
            if bar == 0 or self.chance.random() < 0.3:
                divisions = self.chance.choice([1, 2, 12, 480, 10080])
                attributes = SubElement(measure, "attributes")
                form = self.chance.choice(["{}", " {} ", "{}.0"])
                SubElement(attributes, "divisions").text = form.format(divisions)
                if bar == 0:
                    time = SubElement(attributes, "time", symbol="common")
                    SubElement(time, "beats").text = self.chance.choice(["4", "3+1", "2 + 2"])
                    SubElement(time, "beat-type").text = "4"
            if self.chance.random() < 0.3:
                self._odd(measure)
            self._voice(measure, bar, divisions)
            if self.chance.random() < 0.4:
                back = SubElement(measure, "backup")
                SubElement(back, "duration").text = str(4 * divisions)
                self._voice(measure, bar, divisions)

    def _odd(self, measure: Element) -> None:
        """What nothing plays."""
        tag = self.chance.choice(["print", "unknown", "link", "direction", "harmony"])
        odd = SubElement(measure, tag)
        if tag == "direction":
            SubElement(SubElement(odd, "direction-type"), "words").text = "dolce"

    def _voice(self, measure: Element, bar: int, divisions: int) -> None:
        left, voice = 4 * divisions, self.chance.choice(["1", "2", "", None])
        while left:
            ticks = min(left, self.chance.choice([1, 2, 3, 4, divisions]))
            begin = Fraction(4 * bar) + 4 - Fraction(left, divisions)
            lasting = Fraction(ticks, divisions)
            kind = self.chance.choice(["note", "note", "chord", "rest", "forward", "grace"])
            if kind == "forward" and left > ticks:
                SubElement(SubElement(measure, "forward"), "duration").text = str(ticks)
            elif kind in ("rest", "forward"):
                SubElement(self._note(measure, ticks, voice), "rest")
            else:
                if kind == "grace":
                    for part_of_chord in range(self.chance.choice([1, 2])):
                        word = self._pitch(self._note(measure, None, voice, part_of_chord > 0))
                        grace = max(begin - _GRACE, Fraction(0))
                        self.notes.append(Note(grace, word, _GRACE))
                for part_of_chord in range(1 + (kind == "chord")):
                    note = self._note(measure, ticks, voice, part_of_chord > 0)
                    self.notes.append(Note(begin, self._pitch(note), lasting))
            left -= ticks

    def _note(
        self, measure: Element, ticks: int | None, voice: str | None, is_in_chord: bool = False
    ) -> Element:
        note = SubElement(measure, "note", {"default-x": "12.5"})
        if ticks is None:
            SubElement(note, "grace", slash="yes")
        if is_in_chord:
            SubElement(note, "chord")
        if ticks is not None:
            SubElement(note, "duration").text = self.chance.choice(["{}", "{}.0"]).format(ticks)
        if voice is not None:
            SubElement(note, "voice").text = voice
        return note

    def _pitch(self, note: Element) -> str:
        pitch = SubElement(note, "pitch")
        step, octave = self.chance.choice("CDEFGAB"), self.chance.randrange(1, 8)
        sign, alter = self.chance.choice([("", None), ("", "0"), ("#", "1"), ("b", "-1.0")])
        SubElement(pitch, "step").text = step
        if alter is not None:
            SubElement(pitch, "alter").text = alter
        SubElement(pitch, "octave").text = str(octave)
        return f"{step}{sign}{octave}"

    def written(self, path: Path) -> Path:
        """Write the file under the ending that its form asks for."""
        root = self._by_measures() if self.chance.random() < 0.3 else self.root
        text = ElementTree.tostring(root, encoding="unicode")
        if self.chance.random() < 0.2:
            text = text.replace("<", "<m:").replace("<m:/", "</m:")
            text = text.replace(f"<m:{root.tag} ", f'<m:{root.tag} xmlns:m="urn:x" ', 1)
        encoding = self.chance.choice(
            ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"]
        )
        says = self.chance.choice(["UTF-8", "utf-16"]) if encoding[:5] == "utf-8" else encoding
        head = f"<?xml version='1.0' encoding='{says[:10]}'?>"
        if not encoding.startswith("utf-8") or self.chance.random() < 0.5:
            text = head + text
        data = text.encode(encoding)
        if self.chance.random() < 0.5:
            path = path.with_suffix(self.chance.choice([".xml", ".musicxml"]))
            path.write_bytes(data)
            return path
        path = path.with_suffix(".mxl")
        path.write_bytes(self._packed(data))
        return path

    def _by_measures(self) -> Element:
        root = Element("score-timewise", version="2.0")
        root.append(self.root[0])
        for bar in range(self.n_bars):
            measure = SubElement(root, "measure", number=str(bar + 1))
            for part in self.root.findall("part"):
                SubElement(measure, "part", id=part.get("id", "")).extend(part[bar])
        return root

    def _packed(self, data: bytes) -> bytes:
        file = io.BytesIO()
        method = self.chance.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
        name, named = self.chance.choice([("a.xml", "a.xml"), ("a b.xml", "a%20b.xml")])
        with zipfile.ZipFile(file, "w", method) as archive:
            archive.writestr("mimetype", "application/vnd.recordare.musicxml")
            if self.chance.random() < 0.5:
                archive.writestr("__MACOSX/._a.xml", b"\0\5\x16\7")
            else:
                kind = self.chance.choice(["", ' media-type="application/vnd.recordare+xml"'])
                pdf = '<rootfile full-path="a.pdf" media-type="application/pdf"/>'
                files = f'{self.chance.choice(["", pdf])}<rootfile full-path="{named}"{kind}/>'
                container = f"<container><rootfiles>{files}</rootfiles></container>"
                archive.writestr("META-INF/container.xml", container)
            archive.writestr(name, data)
        return file.getvalue()


@pytest.mark.parametrize("seed", range(60))
def test_musicxml_of_other_programs(seed: int, tmp_path: Path) -> None:
    writer = Writer(seed)
    path = writer.written(tmp_path / "a")
    if not writer.notes:
        with pytest.raises(TakeError, match="it has no notes"):
            part_notes(path, None)
        return
    read, length = part_notes(path, None)
    assert length == 4 * writer.n_bars
    expected = sorted((float(n.begin), n.word, float(n.lasting)) for n in writer.notes)
    assert sorted((n.at, n.word, n.length) for n in read) == expected


def score(*measures: str, ids: tuple[str, ...] = ("P1",)) -> str:
    parts = (
        f'<part id="{name}">' + "".join(f"<measure>{text}</measure>" for text in measures)
        for name in ids
    )
    text = "".join(f"{part}</part>" for part in parts)
    return f"<score-partwise><part-list/>{text}</score-partwise>"


def note(step: str = "C", duration: str = "4", more: str = "", octave: str = "4") -> str:
    pitch = f"<pitch><step>{step}</step><octave>{octave}</octave></pitch>"
    return f"<note>{pitch}<duration>{duration}</duration>{more}</note>"


def ended(number: str, step: str, more: str = "") -> str:
    begin, end = (f'<ending number="{number}" type="{kind}"/>' for kind in ("start", "stop"))
    return f"<barline>{begin}</barline>{note(step)}<barline>{end}{more}</barline>"


@pytest.mark.parametrize(
    ("first", "second", "order"),
    [("1-3", "4", "ABABABAC"), ("1.", "2.", "ABAC"), ("1., 2.", "3.", "ABABAC")],
)
def test_endings_as_programs_number_them(first: str, second: str, order: str, tmp_path: Path):
    path = tmp_path / "a.musicxml"
    back = '<repeat direction="backward"/>'
    path.write_text(score(note("A"), ended(first, "B", back), ended(second, "C")))
    assert "".join(n.word[0] for n in part_notes(path, None)[0]) == order


@pytest.mark.parametrize(
    ("mark", "bpm"),
    [("<beat-unit>quarter</beat-unit><per-minute>c. 80</per-minute>", 80.0),
     ("<beat-unit>half</beat-unit><per-minute>60-66</per-minute>", 120.0),
     ("<beat-unit>long</beat-unit><per-minute>5</per-minute>", 80.0),
     ("<beat-unit>64th</beat-unit><beat-unit-dot/><per-minute>640</per-minute>", 60.0)],
)  # fmt: skip
def test_metronome_marks_as_programs_write(mark: str, bpm: float, tmp_path: Path):
    path = tmp_path / "a.musicxml"
    mark = f"<direction><direction-type><metronome>{mark}</metronome></direction-type></direction>"
    path.write_text(score(mark + note()))
    assert read_score(path).tempos == ((0.0, bpm),)


@pytest.mark.parametrize(
    ("text", "noun"),
    [
        ('<note time-only="1">' + note()[6:], "time-only note"),
        (note(more='<notations><tied type="start"/></notations>'), "drawn tie"),
        (note(more="<notations><slur/></notations>"), "slur"),
        (note(more="<notations><technical><pizzicato/></technical></notations>"),
         "playing technique"),
        (note(more="<notations><articulations><tenuto/></articulations></notations>"),
         "articulation"),
        (note(octave="11"), "unplayable note"),
        (note(duration="1e3"), "durationless note"),
        ("<attributes><measure-style><measure-repeat/></measure-style></attributes>",
         "repeated bar"),
        ("<attributes><transpose><double/></transpose></attributes>", "doubled octave"),
        ("<barline><fermata/></barline>", "fermata"),
        ("<figured-bass/>", "figured-bass sign"),
        ("<wobble/>", "<wobble> element"),
        (note(more="<wobble/>"), "<wobble> element"),
        ('<sound tempo="0"/>', "tempo"),
        ('<sound pizzicato="yes"/>', "sound setting"),
        ("<direction><direction-type><metronome><beat-unit>quarter</beat-unit>"
         "<beat-unit>half</beat-unit></metronome></direction-type></direction>", "tempo"),
        ("<direction><direction-type><dynamics><n/></dynamics></direction-type></direction>",
         "dynamic mark"),
    ],
)  # fmt: skip
def test_unplayed_musicxml_content_is_named(text: str, noun: str, tmp_path: Path):
    path = tmp_path / "a.musicxml"
    path.write_text(score(text + note()))
    assert {name: n for name, n in read_score(path).skipped_counts.items() if n} == {noun: 1}


def test_marks_of_dynamics_at_notes(tmp_path: Path):
    path = tmp_path / "a.musicxml"
    marked = note(more="<notations/><notations><dynamics><sfp/></dynamics></notations>")
    accent = "<notations/><notations><articulations><accent/></articulations></notations>"
    path.write_text(score(marked + note() + note(more=accent)))
    assert [round(7 * (n.strength or 0.0)) for n in part_notes(path, None)[0]] == [5, 2, 3]


def test_missing_parts_of_measures_are_silent(tmp_path: Path):
    path = tmp_path / "a.musicxml"
    bars = ("<part id='a'>{0}</part><part id='b'>{1}</part>", "<part id='a'>{0}</part>") * 2
    texts = (f"<measure>{bar.format(note('A'), note('B'))}</measure>" for bar in bars)
    path.write_text(f"<score-timewise><part-list/>{''.join(texts)}</score-timewise>")
    assert [n.at for n in part_notes(path, "b")[0]] == [0.0, 8.0]


@pytest.mark.parametrize("ids", [("P1", "P1"), ("", "")])
def test_parts_with_equal_ids_are_refused(ids: tuple[str, ...], tmp_path: Path):
    path = tmp_path / "a.musicxml"
    path.write_text(score(note(), ids=ids))
    with pytest.raises(TakeError, match="two of its parts have the id"):
        part_notes(path, None)
    measure = f"<measure><part id='a'>{note()}</part><part id='a'>{note()}</part></measure>"
    path.write_text(f"<score-timewise><part-list/>{measure}</score-timewise>")
    with pytest.raises(TakeError, match="the part 'a' twice"):
        part_notes(path, None)


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_damaged_archives_of_musicxml(method: int, tmp_path: Path):
    """A file that is changed at random is read or refused with a sentence."""
    file, chance = io.BytesIO(), random.Random(method)
    with zipfile.ZipFile(file, "w", method) as archive:
        archive.writestr("ü.xml", score(note()))
    path = tmp_path / "a.mxl"
    n_refused = 0
    for _ in range(200):
        data = bytearray(file.getvalue())
        for _ in range(chance.choice([1, 2, 5])):
            data[chance.randrange(len(data))] = chance.randrange(256)
        path.write_bytes(bytes(data))
        try:
            part_notes(path, None)
        except TakeError:
            n_refused += 1
    assert n_refused > 20


@pytest.mark.parametrize("part_ids", [("P1",), ("P1", "P2", "P3")], ids=["one part", "three parts"])
def test_divisions_without_a_common_grid(part_ids: tuple[str, ...], tmp_path: Path):
    """Exact fractions of thousands of divisions grow until a sum takes seconds."""
    chance = random.Random(1)
    path = tmp_path / "a.musicxml"
    texts = (
        f"<attributes><divisions>{chance.randrange(10**9, 10**10)}</divisions></attributes>"
        for _ in range(20)
    )
    path.write_text(score(*(text + note() for text in texts), ids=part_ids))
    with pytest.raises(TakeError, match="no common grid"):
        read_score(path)
