"""MAGNET, beside an exact solution, and beside an LNL with the same law."""

import numpy as np
import pytest
from checked import check
from scipy.integrate import solve_ivp

from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

K, G, M, STIFF = 2e-4, 5e-3, 0.01, 300.0  # [N·m²], [m], [kg], [N/m]
SCORE = """\
ergon: 1
rates: {{audio: 44100Hz}}
accuracy: {{error: -90dB}}
instruments:
  i:
    {more}
    modules:
      pole: {{SOL: {{}}}}
      m: {{CEL: {{M: 10g, K: 300N/m, Z: 0, X0: 4mm, V0: 0.3m/s}}}}
      pull: {{{link}}}
    out: {{SOX: m}}
render: {{bits: float, tail: 0.2s}}
"""
MAGNET = "MAGNET: {between: [pole, m], k: 200Nmm2, g: 5mm}"


def score(link: str = MAGNET, more: str = "") -> str:
    return SCORE.format(link=link, more=more)


def rendered(text: str) -> np.ndarray:
    """The output of a score (n_frames,)."""
    built = stage(check(text).piece, planned=True)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound[:, 0]


def test_magnet_beside_exact_solution():
    ours = rendered(score())
    times = np.arange(len(ours)) / 44_100

    def motion(_: float, state: np.ndarray) -> list[float]:
        x, v = state
        return [v, (-STIFF * x - K / max(x + G, 0.1 * G) ** 2) / M]

    solved = solve_ivp(motion, (0, times[-1]), [4e-3, 0.3], "DOP853", times, rtol=1e-12, atol=1e-15)
    right = solved.y[0]
    assert np.ptp(right) > 5e-3
    assert np.abs(ours - right).max() < 1e-4 * np.abs(right).max()


@pytest.mark.parametrize("more", ["", "transpose: 5st"])
def test_magnet_as_written_law(more: str):
    law = 'LNL: {between: [pole, m], law: "k/max(d + g, 0.1*g)**2", k: 2e-4, g: 5mm}'  # the formula
    np.testing.assert_array_equal(rendered(score(more=more)), rendered(score(law, more)))


def test_magnet_with_negative_strength():
    attracted = rendered(score())
    repelled = rendered(score(MAGNET.replace("200N", "-200N")))
    assert repelled.mean() > attracted.mean()


def test_magnet_in_space():
    text = """\
ergon: 1
accuracy: {method: ca}
instruments:
  i:
    space: 2
    modules:
      pole: {SOL: {X0: [0, 0]}}
      m: {MAS: {M: 10g, X0: [3cm, 4cm]}}
      pull: {MAGNET: {between: [pole, m], k: 200Nmm2, g: 10mm}}
    out: {SOF: pull}
render: {bits: float, tail: 1ms}
"""
    # A force that shortens the distance is heard as a negative one.
    assert rendered(text)[0] == pytest.approx(-2e-4 / 0.06**2, rel=1e-6)


def test_magnet_with_following_constant():
    follows = "{k: {of: key, from: 0, to: 2e-4, span: 10mm}}"
    link = f"MAGNET: {{between: [pole, m], g: 5mm, follows: {follows}}}"
    key = "keys: {key: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}\n"
    loaded = load("s.yaml", text=score(link) + key)
    assert not loaded.diagnostics
    pull = loaded.piece.instruments["i"].modules[2]
    assert (pull.kind, pull.shown_kind) == ("LNL", "MAGNET")
    assert pull.fields["follows"]["k"].stop == 2e-4


@pytest.mark.parametrize(
    ("link", "message"),
    [
        ("MAGNET: {between: [pole, m], g: 5mm}", "module 'i.pull': a MAGNET needs k"),
        ("MAGNET: {between: [pole, m], k: 1Nmm2}", "module 'i.pull': a MAGNET needs g"),
        (MAGNET.replace("5mm", "0mm"), "g of module 'i.pull': '0mm' is not positive"),
        (MAGNET.replace("200Nmm2", "200N/m"), "k of module 'i.pull': unit 'N/m' does not measure"),
        (MAGNET.replace("pole, m", "m, m"), "MAGNET 'i.pull': both ends are"),
    ],
)
def test_magnet_with_mistakes(link: str, message: str):
    mistakes = [one.message for one in load("s.yaml", text=score(link)).diagnostics]
    assert len(mistakes) == 1
    assert mistakes[0].startswith(message), mistakes
