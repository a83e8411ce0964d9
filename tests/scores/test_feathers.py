"""Feathers, large and small: how many modules move, their pitches, and that they can be divided."""

import re
from math import log2
from pathlib import Path

import numpy as np
import pytest
from sweep import few

from ergon import _core, scores
from ergon.api import score as api
from ergon.api.options import AccuracyOptions
from ergon.common.report import Report
from ergon.notation.text.errors import Collector
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.built_network import BuiltNetwork, build_network
from ergon.scores.staging.listening import audible_outputs
from ergon.scores.staging.stage import Stage
from ergon.scores.staging.striking import ALL_INSTANTS, Striking

LIBRARY = Path(scores.__path__[0]) / "library"
BOTH = ("feathers", "feathers-small")
HARMONICS = (8, 9, 10, 11, 12, 13, 14, 15, 16, 18, 20, 24)  # of 20 Hz: the twelve strings
LOWEST = 20.0  # Hz
C, MEETING = 85.0, 24.0  # s: the canon begins, and all of its strings meet


def piece_of(name: str) -> Piece:
    piece = load(LIBRARY / f"{name}.yaml").piece
    assert piece is not None
    return piece


class Counted:
    """A timeline that counts what is struck."""

    def __init__(self, network: _core.Network) -> None:
        self.timeline = _core.Timeline(network, 44_100.0)
        self.ergons = 0

    def strike(self, *args: object, **named: object) -> None:
        self.ergons += 1

    def rain(self, *args: object, **named: object) -> None:
        self.ergons += self.timeline.rain(*args, **named)  # type: ignore[arg-type]


def ergons_of(piece: Piece, built: BuiltNetwork) -> int:
    counted, collector = Counted(built.assembly.network), Collector()
    for item in piece.strikes:
        mats = [mat for target in item.to for mat in built.assembly.members(target)]
        Striking(piece, counted, item, mats, 0, ALL_INSTANTS, built.assembly).play(collector)  # type: ignore[arg-type]
    assert not collector.has_errors()
    return counted.ergons


@pytest.mark.parametrize(
    ("name", "modules", "within"),
    few([("feathers", 245_000, 0.02), ("feathers-small", 20_000, 0.15)], 1),
)
def test_feathers_module_counts(name: str, modules: int, within: float) -> None:
    """Each ergon counts as two: the MAS that flies, and the BUT by which it strikes."""
    piece = piece_of(name)
    built = build_network(piece, ())
    network = built.assembly.network
    moved = network.n_mat + network.n_lia + 2 * ergons_of(piece, built)
    assert moved == pytest.approx(modules, rel=within)


@pytest.mark.parametrize("name", BOTH)
def test_harp_and_sky_are_harmonics_of_the_lowest_thread(name: str) -> None:
    piece = piece_of(name)
    for number, harmonic in enumerate(HARMONICS, 1):
        partial = next(one for one in piece.instruments[f"h{number}"].modules if one.name == "p1")
        assert partial.fields["f"] == pytest.approx(LOWEST * harmonic)
    (sky,) = piece.instruments["sky"].modules
    count, half = sky.fields["count"], 600 * log2(500) / (sky.fields["count"] - 1)  # cents
    named = [one for one in piece.strikes if one.name == "series" or one.name.startswith("halo")]
    threads = {target.first for one in named for target in one.to}
    assert len(threads) == 29
    for thread in threads:
        ratio = 500 ** (thread / (count - 1))
        assert abs(1200 * log2(ratio / round(ratio))) <= half, thread


@pytest.mark.parametrize("name", BOTH)
def test_feathers_canon_entries_meet_and_separate(name: str) -> None:
    piece = piece_of(name)
    starts: dict[str, list[float]] = {}
    for play, begun in zip(piece.parts, piece.starts, strict=True):
        within = [at - C for at in begun or () if C <= at < C + 40]
        starts.setdefault(play.player, []).extend(within)
    harp = [starts[player] for player in piece.players]
    assert len(harp) == 12
    for played, harmonic in zip(harp, HARMONICS, strict=True):
        assert played, harmonic
        every = 24 / harmonic
        np.testing.assert_allclose(np.diff(played), every, rtol=1e-9)
        assert min(abs(at - MEETING) for at in played) < 1e-6
        assert played[0] <= MEETING
    assert len({round(played[0], 3) for played in harp}) >= 10  # they enter one by one


def from_the_serpent(name: str) -> str:
    """The score from E on: sky, gong and harp sound from its first second on."""
    text = (LIBRARY / f"{name}.yaml").read_text(encoding="utf-8")
    text = text[: text.index("  # A, Hole")] + text[text.index("  # E, Serpent") :]
    text = re.sub(r"\n    [ABCD](\+\S+)? .*", "", text)
    text = re.sub(r"\nduet:\n.*", "", text)
    return re.sub(r"marks: {.*}", "marks: {E: 1|1, F: 8|1}", text)


def planned(text: str, silent: tuple[str, ...] | None) -> Stage:
    loaded = load(LIBRARY / "here.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    names = {instrument.name for _, instrument, _ in audible_outputs(loaded.piece)}
    quiet = sorted(names - {"sky", "gong"}) if silent is None else silent
    return api.stage_piece(loaded, AccuracyOptions(), Report(), silent=quiet).stage


def computed(stage: Stage, seconds: float) -> np.ndarray:
    frames = np.zeros((int(seconds * stage.rate), stage.simulation.n_out))
    stage.simulation.process(frames)
    return frames


@pytest.mark.slow  # plans it three times
def test_feathers_frozen_plus_live_equals_complete() -> None:
    """By the hands that stand in, bit for bit."""
    text = from_the_serpent("feathers-small")
    complete = planned(text, ())
    frozen, live = planned(text, None), planned(text, ("sky", "gong"))
    sky, gong = complete.listening.taps("sky"), complete.listening.taps("gong")
    together = computed(live, 0.3)
    assert np.max(np.abs(together[:, [*sky, *gong]])) == 0.0
    together[:, [*sky, *gong]] = computed(frozen, 0.3)[:, [*sky, *gong]]
    sound = computed(complete, 0.3)
    for part in ("sky", "gong", "h1", "h2"):
        assert np.max(np.abs(sound[:, complete.listening.taps(part)])) > 0.0, part
    np.testing.assert_array_equal(together, sound)
