"""Edits of what players play, and from which beat."""

from pathlib import Path

import pytest
from edited import DUET, SCORES, TWO, begun, lines, opened, piece_of
from sweep import crossed, few

from ergon.notation.text.edit import EditError
from ergon.scores.edits import parts
from tests.support.entries import parse_entry


def test_play_splits_entry_at_beat():
    texts, piece = opened(DUET)
    after = parts.play(texts, piece, "ada", 8.0, parse_entry("roll every 2"))
    assert lines(texts, after) == (
        [
            "    - {at: A, play: knock, every: 1, times: 16}",
            "    - {at: B, play: lean, do: [mirror], times: 4}",
            "    - {at: C, play: soft, every: 1, times: 16, do: [jitter 4ms 0.2mm]}",
        ],
        [
            "- {at: A, play: knock, every: 1, times: 16, until: 3|1}",
            "- {at: 3|1, play: roll, every: 2, until: 999|1}",
        ],
    )
    new = begun(piece_of(after), "ada")
    assert [x for x in new if x[0] < 8] == [x for x in begun(piece, "ada") if x[0] < 8]
    assert [x for x in new if x[0] >= 8][:3] == [(8 + 2 * i, "roll", ()) for i in range(3)]


def test_play_edits_a_table_of_parts():
    texts, piece = opened(DUET)
    after = parts.play(
        texts, piece, "remi", 8.0, parse_entry("lean every 4 times 2 layer do scale 0.5, mirror")
    )
    assert lines(texts, after)[1] == [
        "A      lean every 8 times 2 until 3|1",
        "3|1    lean every 4 times 2 layer do scale 0.5, mirror",
    ]
    again = parts.play(after, piece_of(after), "remi", 10.0, parse_entry("lean"))
    assert lines(after, again)[1] == [
        "3|1    lean every 4 times 2 layer do scale 0.5, mirror until 3|3",
        "3|3    lean",
    ]


@pytest.mark.parametrize(
    ("words", "written"),
    [
        ("tap", "{at: 3|1.5, play: tap}"),
        ("tap every 1/2 times 3", "{at: 3|1.5, play: tap, every: 1/2, times: 3}"),
        ("tap every 1 until C", "{at: 3|1.5, play: tap, every: 1, until: C}"),
        ("tap layer grain 5ms", "{at: 3|1.5, play: tap, layer: true, grain: 5ms}"),
        ("tap do jitter 4ms 0.2mm", "{at: 3|1.5, play: tap, do: [jitter 4ms 0.2mm]}"),
    ],
)
def test_play_words_become_entry_fields(words, written):
    texts, piece = opened(TWO)
    after = parts.play(texts, piece, "ada", 8.5, parse_entry(words))
    assert lines(texts, after)[1][-1] == f"- {written}"
    piece_of(after)


def test_play_for_player_without_part():
    text = Path(TWO).read_text().split("parts:")[0] + "parts:\n  ada:\n"
    texts, piece = opened(TWO, text)
    after = parts.play(texts, piece, "remi", 0.0, parse_entry("tap"))
    assert lines(texts, after) == ([], ["remi:", "- {at: 1|1, play: tap}"])
    texts, piece = opened(TWO, text.replace("parts:\n  ada:\n", ""))
    after = parts.play(texts, piece, "remi", 0.0, parse_entry("tap"))
    assert lines(texts, after) == ([], ["parts:", "remi:", "- {at: 1|1, play: tap}", ""])


@pytest.mark.parametrize("words", ["", "every 1", "tap evry 1", "tap do swing"])
def test_play_refuses_incomplete_words(words):
    texts, piece = opened(TWO)
    with pytest.raises(EditError):
        parts.play(texts, piece, "ada", 8.0, parse_entry(words))


def test_transform_changes_gestures_and_keeps_their_times():
    texts, piece = opened(TWO)
    old = begun(piece, "ada")
    after = parts.transform(texts, piece, "ada", 9.0, ["mirror", "scale 1.2"])
    new = begun(piece_of(after), "ada")
    assert [start for start, *_ in new] == [start for start, *_ in old]
    for (start, what, do), (_, was, done) in zip(new, old, strict=True):
        # Of the entry that sounds, all that is left; what was to come later is as it was.
        more = ("mirror", "scale") if 9.0 <= start < 16.0 else ()
        assert (what, do) == (was, (*done, *more))
    twice = parts.transform(after, piece_of(after), "ada", 10.0, ["reverse"])
    assert ("mirror", "scale", "reverse") in {do[-3:] for _, _, do in begun(piece_of(twice), "ada")}


def test_transform_gesture_under_way():
    texts, piece = opened(DUET)
    texts = parts.play(texts, piece, "ada", 4.0, parse_entry("lean"))
    after = parts.transform(texts, piece_of(texts), "ada", 6.0, ["mirror"])
    assert begun(piece_of(after), "ada")[-2:] == [(4.0, "lean", ()), (6.0, "lean", ("mirror",))]
    with pytest.raises(EditError, match="plays nothing"):
        parts.transform(texts, piece_of(texts), "ada", 9.0, ["mirror"])


@pytest.mark.parametrize(("score", "what"), [(DUET, "lean"), (TWO, "tap")])
def test_transform_gesture_beginning_at_beat(score, what):
    texts, piece = opened(score)
    texts = parts.play(texts, piece, "ada", 8.0, parse_entry(f"{what} every 2 times 3 do mirror"))
    once = parts.transform(texts, piece_of(texts), "ada", 8.0, ["scale 0.5"])
    twice = parts.transform(once, piece_of(once), "ada", 8.0, ["reverse"])
    before, after = begun(piece_of(texts), "ada"), begun(piece_of(twice), "ada")
    assert [where for where in after if where[0] < 8.0] == [b for b in before if b[0] < 8.0]
    do = ("mirror", "scale", "reverse")
    assert [where for where in after if where[0] >= 8.0] == [
        (8.0, what, do),
        (10.0, what, do),
        (12.0, what, do),
    ]


@pytest.mark.parametrize(("path", "beat"), crossed(SCORES, [0.0, 6.5, 17.0]))
def test_rest_keeps_begun_gestures(path, beat):
    texts, piece = opened(path)
    after = parts.end_part(texts, piece, None, beat)
    for player in piece.players:
        assert begun(piece_of(after), player) == [x for x in begun(piece, player) if x[0] < beat]


@pytest.mark.parametrize("beat", few([0.0, 9.0, 17.0, 40.0], [9.0]))
def test_hush_leaves_no_later_ergons(beat):
    for path in SCORES:
        texts, piece = opened(path)
        silent = piece_of(parts.end_all_parts(texts, piece, beat))
        tempo = silent.tempo_map
        for strikes in silent.strikes:
            assert tempo.resolve(strikes.at) < beat
            ends = [tempo.resolve(strikes.until)] if strikes.until else []
            if strikes.span:
                ends.append(tempo.after(tempo.resolve(strikes.at), strikes.span))
            if strikes.pattern and not ends:
                places = strikes.place_beats(silent)
                ends.append(places.beat(len(places)))
            elif strikes.hits and not ends:
                # A phrase that has begun plays to its end, as a gesture does.
                falls = [beat for beat, _, _ in strikes.played_hits(piece)]
                ends.append(max(falls if strikes.length is None else strikes.rounds(tempo)))
            elif strikes.every and strikes.times:
                ends.append(
                    tempo.after(tempo.resolve(strikes.at), strikes.every.times(strikes.times - 1))
                )
            assert min(ends, default=tempo.resolve(strikes.at)) <= beat


def test_finish_puts_end_to_endless_entries():
    texts, piece = opened(TWO)
    texts = parts.play(texts, piece, "ada", 8.0, parse_entry("tap every 1"))
    texts = parts.play(texts, piece_of(texts), "remi", 30.0, parse_entry("tap every 1"))
    after = parts.end_endless(texts, piece_of(texts), 20.0)
    assert "999|1" not in after.text
    assert begun(piece_of(after), "ada")[-1][0] == 19.0
    assert begun(piece_of(after), "remi")[-1][0] == 30.0


def test_play_after_bar_950():
    texts, piece = opened(TWO)
    position = 950 * 4.0
    after = piece_of(parts.play(texts, piece, "ada", position, parse_entry("tap every 4")))
    assert begun(after, "ada")[-1][0] > position + 4000


def test_rest_with_aliased_entry():
    text = (
        Path(TWO)
        .read_text()
        .replace(
            "    - {at: B, play: tap, every: 3/4, times: 10, do: [scale 0.8]}\n",
            "    - &b {at: B, play: tap, every: 3/4, times: 10, do: [scale 0.8]}\n",
        )
    )
    text = text.replace("  remi:\n", "  remi:\n    - *b\n")
    texts, piece = opened(TWO, text)
    after = parts.end_part(texts, piece, "remi", 9.0)
    assert (
        "    - {at: B, play: tap, every: 3/4, times: 10, until: 3|2, do: [scale 0.8]}" in after.text
    )
    assert begun(piece_of(after), "ada") == begun(piece, "ada")
