"""Scores that ship as the texts of a session, before and after an edit."""

import difflib
from functools import cache
from itertools import product
from pathlib import Path

import pytest
from sweep import few

from ergon.scores.edits.texts import Texts

ROOT = Path(__file__).parents[2]
BUNDLED = sorted(ROOT.glob("scores/library/*.yaml"))
TEMPLATES = sorted(ROOT.glob("cli/templates/*/score.yaml"))
SCORES = [str(path) for path in BUNDLED + TEMPLATES]
# Scores, and the range of beats of which a part is kept in each.
_BARS = [(0.0, 16.0), (8.0, 16.0), (12.0, 44.0)]
_FEW = [path for path in SCORES if Path(path).stem in ("bloom", "patterns")]
SPANS = few(
    product(SCORES, _BARS), [(path, _BARS[at % len(_BARS)]) for at, path in enumerate(_FEW)]
)
PIECES = ROOT / "tests" / "data" / "pieces"
DUET, TEMPO, TWO = (str(PIECES / f"{name}.yaml") for name in ("duet", "tempo", "two-keys"))


def opened(path, text=None):
    if text is None and path in SCORES:
        return _shipped(path)
    texts = Texts.read(path) if text is None else Texts(path, text)
    return texts, piece_of(texts)


@cache
def _shipped(path):
    texts = Texts.read(path)
    return texts, piece_of(texts)


def piece_of(texts):
    loaded = texts.load()
    assert loaded.piece is not None, [str(d.message) for d in loaded.diagnostics]
    return loaded.piece


def lines(before, after, file=None):
    """Lines removed and lines added."""
    a = Path(file).read_text() if file else before.text
    b = after.overlay[file] if file else after.text
    result = list(difflib.ndiff(a.splitlines(), b.splitlines()))
    return [x[2:] for x in result if x[0] == "-"], [x[2:].strip() for x in result if x[0] == "+"]


def begun(piece, player):
    """(what, beats) of everything that a player plays, in order of time."""
    result = []
    for play, starts in zip(piece.parts, piece.starts, strict=True):
        if play.player != player:
            continue
        for place, start in enumerate(starts or [piece.tempo_map.resolve(play.at)]):
            name, do = play.played_text, play.do
            if play.pattern is not None:  # as it was drawn in this place
                name, do = starts.places.played_name(place), (*do, *starts.places.transforms(place))
            if name is not None:
                result.append((start, name, tuple(t.word for t in do)))
    return sorted(result)


def same(outcome, wanted):
    """The same plays in the same order, at the same beats."""
    assert [rest for _, *rest in outcome] == [rest for _, *rest in wanted]
    assert [beat for beat, *_ in outcome] == pytest.approx([beat for beat, *_ in wanted])


def value(piece, target):
    part, _, name = target.rpartition(".")
    owner, _, module = part.partition(".")
    built = piece.keys.get(owner) or piece.instruments[owner]
    return {m.name: m for m in built.modules}[module].fields[name]
