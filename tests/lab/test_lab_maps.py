"""Maps: known borders come out where they are, and stable is not accurate."""

import math
from dataclasses import replace

import numpy as np
import pytest
from sweep import few

from ergon import _core
from ergon.scores.reading.load import load
from ergon.workshop.lab import canonical, map_catalogue, map_table, maps
from ergon.workshop.lab.names import MAPS, METHODS, ORDERS
from ergon.workshop.lab.runs import Setting, start
from ergon.workshop.lab.stiffness import has_contacts, stiffer
from ergon.workshop.lab.truth import converged

BUILT_IN = map_catalogue.built_in("ca")
BORDERS = {
    (name, method): map_catalogue.built_in(method)[name]
    for method in METHODS
    for name in ("cell", "rate", "coupling")
}


def silent(done: int) -> None:
    pass


def survey(
    name: str, rows: slice = slice(None), method: str = "ca"
) -> tuple[maps.Map, list[maps.Spot]]:
    complete = map_catalogue.built_in(method)[name]
    first = replace(complete, ys=complete.ys[rows])
    return first, maps.survey(first, silent)


def test_stability_map_of_cell_equals_jury_border():
    """K + 2Z = 4M: predicted by formula and certificate, measured within the same grid cell."""
    first, spots = survey("cell")
    for spot in spots:
        inside = spot.x + 2.0 * spot.y < 4.0
        assert (spot.theory, spot.certified, spot.stable) == (inside, inside, inside), spot
    assert {spot.stable for spot in spots} == {True, False}
    assert maps.disagreements(spots) == (0, 0)
    # Stable is not accurate: near the border the cell sings another note.
    last = max((s for s in spots if s.stable and s.y < 0.1), key=lambda s: s.x)
    assert last.x > 3.8
    assert last.accurate is False
    assert any(spot.accurate for spot in spots)
    assert first.n_spots == len(spots)


@pytest.mark.parametrize(("name", "method"), few(BORDERS, [*BORDERS][::2]))
def test_stability_map_borders_of_linear_scenes(name: str, method: str):
    first = BORDERS[name, method]
    ys = first.ys[-1:] if name == "rate" else first.ys[:1]
    spots = [maps.predicted_and_run(first, x, y)[0] for y in ys for x in first.xs]
    for spot in spots:
        assert spot.load is not None
        if abs(spot.load - 1.0) > 1e-3:
            assert spot.theory == spot.certified, spot
            # What is refused is run all the same: predicted and measured borders are one. Only the
            # stability polynomial of bm4 touches its border and comes back.
            assert spot.stable == spot.theory or (method == "bm4" and spot.stable), spot
    if math.isfinite(canonical.eigenvalue_limit(method)):
        assert {spot.theory for spot in spots} == {True, False}


@pytest.mark.slow
def test_modal_maps_of_linear_scenes_stable_and_accurate():
    """Also at 4 kHz, and for a joint a hundred times too stiff for the CA scheme."""
    for name in ("cell", "rate", "coupling"):
        _, spots = survey(name, slice(0, 2), "modal")
        assert all(spot.stable for spot in spots)
        assert not any(spot.accurate is False for spot in spots)
        assert any(spot.accurate for spot in spots)


def test_modal_map_of_contact_has_ca_loads():
    for name in ("contact", "strike"):
        item, plain = BUILT_IN[name], map_catalogue.built_in("modal")[name]
        assert item.load is not None
        assert plain.load is not None
        for x in item.xs:
            assert plain.load(x, 2.0) == item.load(x, 2.0)


def test_contact_map_spots_unstable_despite_certificate():
    """A certificate of a contact guards; what runs away all the same is seen, with its reason."""
    _, spots = survey("contact", slice(2, 3))
    missed, strict = maps.disagreements(spots)
    assert (missed, strict) == (1, 0)
    (spot,) = (s for s in spots if s.certified and s.stable is False)
    assert "times the energy" in spot.reason or "diverged at" in spot.reason


def test_strike_map_theory_bound_conservative():
    _, spots = survey("strike", slice(0, 1))
    assert all(spot.certified for spot in spots)  # at rest nothing is stiff
    assert all(spot.stable for spot in spots if spot.theory)
    assert not all(spot.stable for spot in spots)
    assert any(spot.stable and not spot.theory for spot in spots)


def test_map_loads_equal_certificate_eigenvalues():
    """The formulas against the engine's certificate, where that is exact (beyond the border)."""
    for kappa in (0.5, 3.9):
        network = canonical.coupled(kappa).build_at(canonical.RATE).network
        load = canonical.coupled_load(kappa, 1.0, "ca")
        result = network.certify(canonical.RATE).lambda_max / 4.0
        assert load <= result * (1.0 + 1e-12)
        assert result <= 2.0 * load  # Gershgorin
    scene = canonical.string(30, 44100.0)
    border = 44100.0 * math.sqrt(canonical.string_load(30, 44100.0, "ca"))
    network = scene.build_at(44100.0).network
    network.certify(border * (1.0 + 1e-6))
    with pytest.raises(_core.UnstableError):
        network.certify(border * (1.0 - 1e-6))


def test_map_catalogue_covers_all_methods_and_maps():
    assert tuple(BUILT_IN) == MAPS
    for method in METHODS:
        assert canonical.eigenvalue_limit(method) >= 4.0
        assert set(map_catalogue.built_in(method)) == set(MAPS)
    assert ORDERS["ca"] == 2


@pytest.mark.parametrize("method", ["plan", "ca"])
def test_energy_map_of_rattle_by_method(method: str):
    """A mass on an undamped spring that meets a stop: by steps of CA a stiff one runs away."""
    (complete,) = map_catalogue.maps(method, None, 0.5, None, "energy").values()
    first = replace(complete, xs=complete.xs[4::8], ys=complete.ys[::4], seconds=0.2)
    spots = maps.survey(first, silent)
    assert all(spot.energy_db is not None for spot in spots if spot.stable)
    saved = [spot.stable and spot.accurate for spot in spots]
    assert all(saved) if method == "plan" else {True, False} == set(saved)
    assert "energy_db of at most -20 dB" in map_table.csv({"rattle": (first, spots)}, method)


def test_energy_map_of_score_by_ledger():
    piece = load("two.yaml", text=TEXT).piece
    assert piece is not None
    result = map_catalogue.maps("plan", piece, 0.1, None, "energy")["contacts"]
    spot = maps.compute_spot(result, 1.0, 1.0)
    assert (spot.stable, spot.accurate, spot.error_db) == (True, True, None)


def test_converged_truth_repeats_at_half_rate():
    result = converged(canonical.string(20, 44100.0), 4410)
    assert result.frames is not None
    assert result.change_db < -45.0
    far = start(canonical.string(20, 44100.0), Setting("ca", 128)).frames(4410)
    assert np.abs(result.frames - far).max() < 0.01 * np.abs(far).max()


def test_start_unchecked_runs_unstable_scene():
    scene = canonical.cell(4.2, 0.0)
    with pytest.raises(_core.UnstableError):
        start(scene, Setting("ca"))
    with pytest.raises(_core.DivergedError):
        start(scene, Setting("ca"), unchecked=True).frames(4410)


# --- scores -------------------------------------------------------------------------------------

TEXT = """\
ergon: 1
title: Two masses
instruments:
  b:
    modules:
      a: {MAS: {M: 1g, V0: 1m/s}}
      g: {SOL: {}}
      s: {REF: {between: [a, g], K: 300kN/m, Z: 0.1Ns/m}}
      c: {CEL: {M: 2g, f: 300Hz, t60: 1s}}
      t: {BUT: {between: [a, c], K: 5kN/m, gap: 0mm, side: below}}
      n: {LNL: {between: [a, c], law: k*d, k: 100}}
    out: {SOX: c}
render: {tail: 1s}
"""


def piece(text: str = TEXT):
    loaded = load("here.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def test_stiffer_scales_every_spring_of_piece():
    fields = {m.name: m.fields for m in stiffer(piece(), 4.0).instruments["b"].modules}
    assert fields["s"]["K"] == 1.2e6
    assert fields["s"]["Z"] == 0.1
    assert fields["c"]["f"] == 600.0
    assert fields["t"]["K"] == 20e3
    law = _core.Law(fields["n"]["law"], constants=fields["n"]["constants"])
    assert law.force(0.01) == pytest.approx(4.0)
    only = {
        m.name: m.fields for m in stiffer(piece(), 4.0, contacts_only=True).instruments["b"].modules
    }
    assert (only["s"]["K"], only["c"]["f"], only["t"]["K"]) == (300e3, 300.0, 20e3)
    assert has_contacts(piece())
    assert not has_contacts(
        piece(TEXT.replace("      t:", "      # t:").replace("      n:", "      # n:"))
    )


def test_score_map_fails_at_certificate_border():
    """λ ≈ K·T²/M: 4 at 44.1 kHz is 7.8 MN/m for 1 g, 26 times the score's."""
    first = map_catalogue.maps_of_score(piece(), 0.05, "ca")["springs"]
    spots = {(s.x, s.y): s for s in maps.survey(first, silent)}
    assert spots[16.0, 1.0].stable is True
    assert spots[32.0, 1.0].stable is False
    assert spots[32.0, 2.0].stable is True
    assert spots[128.0, 2.0].stable is False
    assert all(s.certified == s.stable for s in spots.values() if s.x >= 16.0)
    assert spots[0.25, 4.0].accurate is True
    text = map_table.csv({"springs": (first, list(spots.values()))}, "ca")
    header, *rows = (line for line in text.splitlines() if not line.startswith("#"))
    assert header.startswith("map,x,y,theory,certified,stable,accurate")
    assert len(rows) == first.n_spots
