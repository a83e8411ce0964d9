"""Scores and their bytes, as `check` and `format` read them."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from pathlib import Path

from corrupted import corrupted
from one_bell import SCORE as BELL
from random_scores import Score

from benches.mutated import bases, mutated
from ergon.notation.text.errors import TextError, full
from ergon.notation.text.format import formatted
from ergon.notation.text.memory import Memory
from ergon.scores.reading.load import load
from ergon.scores.staging.preparing import prepare
from ergon.scores.staging.refusals import StageError
from tests.fuzz.harness import Target
from tests.fuzz.texts import damaged, tree
from tests.scores.test_fuzz import SECTIONS, WORDS


def checked(path: str, text: str, overlay: Mapping[str, str] | None = None) -> Iterator[str]:
    """What `check` says of a score, and whether a piece that it takes can be staged."""
    memory = Memory()
    for _ in range(2):  # the second time from what is remembered of the first
        loaded = load(path, text=text, overlay=overlay, memory=memory)
        for item in loaded.diagnostics:
            yield full(item, loaded.files)
        errors = [item for item in loaded.diagnostics if item.severity == "error"]
        assert (loaded.piece is None) == bool(errors)
    if loaded.piece is None:
        return
    players = loaded.piece.players.values()
    live = {player.name: None for player in players if player.hand == "live"}
    for real in [{}, live] if live else [{}]:  # with stand-ins, then with hands as `duet` has them
        try:
            ready = prepare(loaded.piece, real)
        except StageError as error:
            yield str(error)
        else:
            yield from (item.message for item in ready.collector.finish())


LIVE = BELL.replace("hand: virtual", "hand: live, standin: lean, tick: 1kHz")


def _score(chance: random.Random) -> str:
    kind = chance.randrange(10)
    known = bases()
    if kind <= 2:
        text = mutated(chance.choice([*known.values(), BELL, LIVE]), chance)
        # A part that goes beyond the beginning, or hardly lasts.
        return text.replace("play: knock", f"play: knock, {chance.choice(MANNERS)}", 1)
    if kind <= 5:
        return damaged(chance.choice([*known.values(), BELL]), chance, SCORE_WORDS)
    if kind <= 7:
        return damaged(Score(chance.randrange(1 << 30)).text, chance, SCORE_WORDS)
    names = chance.sample(SECTIONS.split(), k=chance.randrange(1, 6))
    return "ergon: 1\n" + "".join(f"{name}: {tree(chance, SCORE_WORDS)}\n" for name in names)


MANNERS = (
    *("do: [shift -9999]", "do: [stretch 1e-9]", "join: 9s"),
    "{hand: live, key: k1, tick: 1kHz}",
)
_PLAIN = ("0mm@0", "1mm@1", "3bar", "-6dB", "sky.all")
SCORE_WORDS = (*WORDS.split(), *SECTIONS.split(), *_PLAIN, *MANNERS)


def _score_bytes(chance: random.Random) -> bytes:
    texts = [text.encode() for text in (*bases().values(), BELL)]
    return next(corrupted(chance.choice(texts), 1, chance.randrange(1 << 30), *texts))


def _read_score_bytes(data: bytes, folder: Path) -> Iterator[str]:
    path = folder / "score.yaml"
    path.write_bytes(data)
    loaded = load(path)
    for item in loaded.diagnostics:
        yield full(item, loaded.files)


def _read_formatted(text: str, folder: Path) -> Iterator[str]:
    once = formatted(text)
    assert formatted(once) == once, "what is formatted changes when it is formatted again"
    yield from ()


TARGETS = (
    Target(
        "scores", _score, lambda text, folder: checked("s.yaml", text), (), 30, 25_000, limit=30.0
    ),
    Target("score bytes", _score_bytes, _read_score_bytes, (), 40, limit=30.0),
    Target("format", _score, _read_formatted, (TextError,), 30, 50_000),
)
