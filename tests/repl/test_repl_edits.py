"""Bars that are kept, and any row of edits: a score at every step."""

import random
from pathlib import Path

import pytest
from edited import SCORES, SPANS, TWO, begun, opened, piece_of, same
from sweep import crossed

from ergon.notation.text.edit import EditError
from ergon.scores.edits import excerpt, keys, matter, names, parts, scenes, times
from ergon.scores.edits.scenes import Scene
from ergon.scores.edits.texts import Texts
from tests.support.entries import parse_entry


@pytest.mark.parametrize(("path", "span"), SPANS)
def test_keep_of_bars_preserves_gestures_and_tempo(path, span):
    start, stop = span
    texts, piece = opened(path)
    tempo = piece.tempo_map
    start -= tempo.bar_beat(start)[1] - 1.0  # from the bar line, whatever the meter
    message = excerpt.excerpt_between(texts, piece, "verse-2", start, stop)
    saved = piece_of(message)
    for player in piece.players:
        inside = [(b - start, *rest) for b, *rest in begun(piece, player) if start <= b < stop]
        same(begun(saved, player), inside)
    for beat in range(int(stop - start)):
        seconds = tempo.seconds(start + beat) - tempo.seconds(start)
        assert saved.tempo_map.seconds(beat) == pytest.approx(seconds, abs=1e-9)
        assert saved.tempo_map.bar_beat(beat)[1] == tempo.bar_beat(start + beat)[1]
    scene = Scene.from_texts(message, saved)
    back = piece_of(scenes.play_scene(texts, piece, scene, 100.0, 100.0 + scene.beats))
    for player in piece.players:
        again = [(b - 100.0, *rest) for b, *rest in begun(back, player) if b >= 100.0]
        same(again, begun(saved, player))


def test_keep_of_bars_without_gestures_is_refused():
    texts, piece = opened(TWO)
    with pytest.raises(EditError, match="no gesture begins"):
        excerpt.excerpt_between(texts, piece, "x", 400.0, 416.0)


def some_line(choice, texts, piece, beat):
    """One edit of any kind."""
    player = choice([*piece.players, None])
    played = [*piece.gestures, *piece.takes]
    name = choice([*played, "fresh"])
    verbs = ["tempo", "mark", "seed", "rest", "hush", "set", "define", "finish"]
    if player is not None:
        verbs += 4 * ["play"] + 2 * ["transform"]
    if len(piece.keys) > 1:
        verbs += ["couple", "uncouple"]
    owner = choice([*piece.keys.values(), *piece.instruments.values()])
    module = choice(owner.modules)
    target = ".".join(filter(None, (owner.name, module.name, choice("MKf"))))
    words = choice(played) + choice(["", " every 1", " every 3/2 times 4", " layer do mirror"])
    tempo = choice([("72",), ("60 -> 90", "2bar")])
    pair = [*piece.keys][:2]
    edits = {
        "play": lambda: parts.play(texts, piece, player, beat, parse_entry(words)),
        "transform": lambda: parts.transform(texts, piece, player, beat, ["scale 0.9", "mirror"]),
        "define": lambda: names.define(texts, name, "0@0 smooth 5@60ms 0@120ms"),
        "set": lambda: matter.set_value(texts, piece, target, "x1.1"),
        "tempo": lambda: times.change_tempo(texts, piece, beat, *tempo),
        "mark": lambda: times.set_mark(texts, piece, name, beat),
        "seed": lambda: names.set_seed(texts, 5),
        "rest": lambda: parts.end_part(texts, piece, player, beat),
        "hush": lambda: parts.end_all_parts(texts, piece, beat),
        "finish": lambda: parts.end_endless(texts, piece, beat),
        "couple": lambda: keys.couple(texts, piece, beat, *pair, "90N/m"),
        "uncouple": lambda: keys.uncouple(texts, piece, beat, *pair),
    }
    verb = choice(verbs)
    return verb, edits[verb]()


# A calibrated key has no f of its own, a take no gesture's name: refused by the score, and said.
REFUSED = {"E111", "E303"}
# A session of hands needs players: `rain` and others are strikes alone.
BY_HAND = [path for path in SCORES if "\nplayers:" in Path(path).read_text(encoding="utf-8")]


@pytest.mark.parametrize(("path", "number"), crossed(BY_HAND, range(6)))
def test_random_edits_load_as_score_after_every_line(path, number):
    chance = random.Random(number)
    texts = Texts.read(path)
    is_crlf = number % 2 == 1
    if is_crlf:
        texts = texts.with_text(texts.text.replace("\n", "\r\n"))
    position, taken = 0.0, 0
    for _ in range(12):
        position += chance.choice([0.0, 1.0, 2.5, 4.0, 8.0])
        piece = piece_of(texts)
        try:
            verb, after = some_line(chance.choice, texts, piece, position)
        except EditError:
            continue
        loaded = after.load()
        if loaded.piece is None:
            codes = {d.code for d in loaded.diagnostics if d.severity == "error"}
            assert codes <= REFUSED, (verb, [str(d.message) for d in loaded.diagnostics])
            continue
        for player in piece.players if verb != "mark" else ():  # what has begun has begun
            # With another seed chance chooses anew, on the same beats.
            known = slice(1) if verb == "seed" else slice(None)
            # What repeats a gesture that was defined anew comes as soon as that is over.
            now = loaded.piece.gestures
            other = {name for name, item in piece.gestures.items() if now.get(name) != item}
            other = other if verb == "define" else set()
            old, new = (
                [
                    x[known]
                    for x in begun(item, player)
                    if x[0] < position - 1e-9 and x[1] not in other
                ]
                for item in (piece, loaded.piece)
            )
            assert new == old, verb
        assert all(("\r\n" in line) == is_crlf for line in after.text.splitlines(True)[:-1])
        texts, taken = after, taken + 1
    assert taken > 3
