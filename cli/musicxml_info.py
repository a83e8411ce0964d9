"""What `ergon info` says of a score of MusicXML."""

from __future__ import annotations

from pathlib import Path

from .console import plural
from .midi_info import changes
from .outcome import Refused

_PARTS_MAX = 64  # parts in lines of their own


def musicxml(path: Path) -> tuple[dict[str, object], list[str]]:
    """The parts, tempos and meters of a file, and what no part of ergon plays."""
    from ergon.scores.gesture.musicxml_file import XmlPart, read_score
    from ergon.scores.gesture.take_file import TakeError

    try:
        score = read_score(path)
    except TakeError as error:
        raise Refused(error.message) from None

    def notes_of(score_part: XmlPart) -> str:
        if not score_part.notes:
            return "no notes"
        notes_by_pitch = sorted(score_part.notes, key=lambda note: note.key)
        low, high = notes_by_pitch[0].word, notes_by_pitch[-1].word
        range_text = low if low == high else f"{low} to {high}"
        strengths = [note.strength for note in score_part.notes if note.strength is not None]
        strengths_text = (
            f", strengths {min(strengths):.2g} to {max(strengths):.2g}" if strengths else ""
        )
        return f"{plural(len(score_part.notes), 'note')}, {range_text}{strengths_text}"

    notes_by_part = {f"part {part.label}": notes_of(part) for part in score.parts[:_PARTS_MAX]}
    if n_unlisted_parts := len(score.parts) - len(notes_by_part):
        notes_by_part["and"] = plural(n_unlisted_parts, "more part")
    tempos = [(quarter, f"{bpm:.6g} bpm") for quarter, bpm in score.tempos]
    figures_read: dict[str, object] = {
        "title": score.title or "none",
        "length": f"{score.length:g} quarters, {plural(score.n_measures, 'bar')} as played",
        **notes_by_part,
        "tempo": changes(tempos, "120 bpm, for the file says none"),
        "meter": changes(score.meters, "4/4, for the file says none"),
    }
    passed_over = [
        plural(count, noun) for noun, count in sorted(score.skipped_counts.items()) if count
    ]
    return figures_read, passed_over
