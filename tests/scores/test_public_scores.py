"""Notes of public MusicXML files beside partitura's, which reads them by other code.

The files are those of the corpus that music21 brings; none is kept here. Elsewhere in that corpus
the two differ: partitura does not join ties whose end is not written (Monteverdi's madrigals), and
fills incomplete bars (BWV 171.6), as music21 does. It leaves out the first repeat of the Maple Leaf
Rag, whose second ending is not marked; with that mark it has the same notes, but for two ties.
Madrigal 3.12 has bars that are twice as long in some parts as in others.
"""

import re
import warnings
from pathlib import Path

import pytest

from ergon.scores.gesture.musicxml_file import part_notes

pytestmark = pytest.mark.slow

_NAMES = """
    bach/bwv11.6.mxl
    bach/bwv124.6.mxl
    bach/bwv125.6.mxl
    bach/bwv126.6.mxl
    bach/bwv149.7.mxl
    bach/bwv155.5.mxl
    bach/bwv156.6.mxl
    bach/bwv169.7.mxl
    bach/bwv184.5.mxl
    bach/bwv194.6.mxl
    bach/bwv244.32.mxl
    bach/bwv244.46.mxl
    bach/bwv244.62.mxl
    bach/bwv248.17.mxl
    bach/bwv248.33-3.mxl
    bach/bwv248.35-3.mxl
    bach/bwv248.35-3c.mxl
    bach/bwv248.42-s.mxl
    bach/bwv251.mxl
    bach/bwv286.mxl
    bach/bwv310.mxl
    bach/bwv316.mxl
    bach/bwv317.mxl
    bach/bwv320.mxl
    bach/bwv321.mxl
    bach/bwv327.mxl
    bach/bwv332.mxl
    bach/bwv343.mxl
    bach/bwv350.mxl
    bach/bwv355.mxl
    bach/bwv356.mxl
    bach/bwv364.mxl
    bach/bwv372.mxl
    bach/bwv388.mxl
    bach/bwv390.mxl
    bach/bwv391.mxl
    bach/bwv396.mxl
    bach/bwv399.mxl
    bach/bwv40.6.mxl
    bach/bwv412.mxl
    bach/bwv417.mxl
    bach/bwv42.7.mxl
    bach/bwv424.mxl
    bach/bwv430.mxl
    bach/bwv434.mxl
    bach/bwv48.3.mxl
    bach/bwv55.5.mxl
    bach/bwv64.4.mxl
    bach/bwv65.2.mxl
    bach/bwv90.5.mxl
    bach/bwv94.8.mxl
    bach/bwv95.7.mxl
    schoenberg/opus19/movement6.mxl
"""
_SEMITONES = {"C": 0, "D": 2, "E": 4, "F": 5, "G": 7, "A": 9, "B": 11}


def _pitch(word: str) -> int:
    """The MIDI note of a name."""
    step, signs, octave = re.fullmatch(r"([A-G])([#b]*)(-?[0-9]+)", word).groups()
    return _SEMITONES[step] + signs.count("#") - signs.count("b") + 12 * (int(octave) + 1)


def _partitura_notes(path: Path) -> list[tuple[float, int, float]]:
    partitura = pytest.importorskip("partitura")
    notes = []
    for part in partitura.load_musicxml(path).parts:
        unfolded = partitura.score.unfold_part_maximal(part, ignore_leaps=True)
        rows = unfolded.note_array()
        columns = rows["onset_quarter"], rows["pitch"], rows["duration_quarter"]
        notes += [
            (float(onset), int(pitch), float(lasting))
            for onset, pitch, lasting in zip(*columns, strict=True)
        ]
    return notes


def _from_first(notes: list[tuple[float, int, float]]) -> list[tuple[float, int, float]]:
    """Notes in order, from the first on; partitura keeps 32 bits of a time."""
    begin = min(onset for onset, _, _ in notes)
    return sorted(
        (round(onset - begin, 2), pitch, round(lasting, 2)) for onset, pitch, lasting in notes
    )


@pytest.mark.parametrize("name", _NAMES.split())
def test_notes_of_public_musicxml_files(name):
    music21 = pytest.importorskip("music21")
    path = Path(music21.__file__).parent / "corpus" / name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        wanted = _partitura_notes(path)
    notes = [(n.at, _pitch(n.word), n.length) for n in part_notes(path, None)[0]]
    assert _from_first(notes) == _from_first(wanted)
