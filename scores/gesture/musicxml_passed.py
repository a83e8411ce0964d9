"""Counts what a score of MusicXML holds and nothing plays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from xml.etree.ElementTree import Element

SHORT_ARTICULATIONS = frozenset({"staccato", "staccatissimo", "spiccato"})
ACCENT_ARTICULATIONS = frozenset({"accent", "strong-accent"})
# What a measure, a note, a direction or a sound may have that nothing plays.
_NOUN_BY_MEASURE_ELEMENT = {"harmony": "chord symbol", "figured-bass": "figured-bass sign"}
_NOUN_BY_NOTE_PATH = {
    "notations/ornaments": "ornament",
    "notations/arpeggiate": "arpeggio",
    "notations/non-arpeggiate": "arpeggio",
    "notations/fermata": "fermata",
    "notations/glissando": "glide",
    "notations/slide": "glide",
    "notations/slur": "slur",
    "notations/technical": "playing technique",
    "lyric": "syllable",
}
_NOUN_BY_DIRECTION = {
    "pedal": "pedal mark",
    "words": "direction",
    "damp": "direction",
    "damp-all": "direction",
    "string-mute": "direction",
    "scordatura": "direction",
    "percussion": "direction",
}
_NOUN_BY_ATTRIBUTE_PATH = {
    "measure-style/measure-repeat": "repeated bar",
    "measure-style/beat-repeat": "repeated beat",
    "transpose/double": "doubled octave",
}
_READ_SOUND_ATTRIBUTES = frozenset(
    {"id", "tempo", "dynamics", "dacapo", "segno", "dalsegno", "coda", "tocoda", "fine"}
)
# What only says how things are drawn, and what is read elsewhere; any other element is named.
_KNOWN_ELEMENTS_TEXT = {
    "measure": "note backup forward direction attributes print sound barline grouping link "
    "bookmark",
    "note": "chord pitch unpitched rest duration tie instrument voice type dot accidental stem "
    "time-modification notehead notehead-text staff beam notations lyric grace cue footnote level",
    "direction": "direction-type offset footnote level voice staff sound",
}
_KNOWN_ELEMENTS = {
    parent: frozenset(names.split()) for parent, names in _KNOWN_ELEMENTS_TEXT.items()
}


class UnplayedCounter:
    """What is counted while the measures of a file are read, by nouns."""

    def __init__(self, counts: Counter[str]) -> None:
        """Count into `counts`."""
        self.counts = counts

    def count_measure_element(self, element: Element) -> None:
        """An element of a measure that is neither a note nor a mark that is read."""
        if element.tag in _NOUN_BY_MEASURE_ELEMENT:
            self.counts[_NOUN_BY_MEASURE_ELEMENT[element.tag]] += 1
        elif element.tag == "barline":
            self.counts["fermata"] += element.find("fermata") is not None
            self.counts["after-jump repeat"] += any(
                repeat.get("after-jump") == "yes" for repeat in element.iterfind("repeat")
            )
        else:
            self._count_unknown("measure", element)

    def count_note(self, note: Element) -> None:
        """What a note has beside its pitch and length."""
        self._count_paths(note, _NOUN_BY_NOTE_PATH)
        self.counts["time-only note"] += note.get("time-only") is not None
        for child in note:
            self._count_unknown("note", child)
        has_tie = note.find("tie") is not None
        self.counts["drawn tie"] += not has_tie and any(
            tied.get("type") == "start" for tied in note.iterfind("notations/tied")
        )
        for mark in note.iterfind("notations/articulations/*"):
            self.counts["articulation"] += (
                mark.tag not in SHORT_ARTICULATIONS | ACCENT_ARTICULATIONS
            )

    def count_direction(self, direction: Element) -> None:
        """What a direction has beside dynamics, hairpins and tempos."""
        for mark in direction.iterfind("direction-type/*"):
            if mark.tag in _NOUN_BY_DIRECTION:
                self.counts[_NOUN_BY_DIRECTION[mark.tag]] += 1
        if direction.tag == "direction":
            for child in direction:
                self._count_unknown("direction", child)

    def count_sound(self, sound: Element) -> None:
        """What a sound sets beside tempos, dynamics and jumps."""
        children = (child.tag for child in sound if child.tag != "offset")
        self.counts["sound setting"] += bool({*sound.keys(), *children} - _READ_SOUND_ATTRIBUTES)

    def count_attributes(self, attributes: Element) -> None:
        """What attributes have beside divisions, meters and transpositions."""
        self._count_paths(attributes, _NOUN_BY_ATTRIBUTE_PATH)

    def _count_paths(self, element: Element, nouns: Mapping[str, str]) -> None:
        for path, noun in nouns.items():
            self.counts[noun] += element.find(path) is not None

    def _count_unknown(self, parent: str, element: Element) -> None:
        if element.tag not in _KNOWN_ELEMENTS[parent]:
            self.counts[f"<{element.tag[:40]}> element"] += 1
