"""Points in space in a real browser: each is drawn once, where its coordinates say."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import browser
import numpy as np
import pytest

from ergon import _core
from ergon.cli import app

SCORE = """\
ergon: 1
instruments:
  throw:
    space: %d
    gravity: 9.81m/s2
    modules:
      nail: {SOL: {X0: %s}}
      ball: {MAS: {M: 20g, X0: %s, V0: %s}}
      thread: {RES: {between: [nail, ball], K: 0.001}}
    out: {SOX: ball.x}
  bell: {CEL: {M: 20g, f: 220Hz, t60: 1s}}
strikes: {one: {to: bell, at: 0, impulse: 1mNs}}
render: {tail: 0.5s}
"""
THROWN = {
    2: SCORE % (2, "[0, 0]", "[10cm, 1m]", "[0.2m/s, 1m/s]"),
    3: SCORE % (3, "[0, 0, 0]", "[10cm, 0, 1m]", "[0.2m/s, 0.3m/s, 1m/s]"),
}


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running() as found:
        yield found


@pytest.mark.parametrize("axes", [2, 3])
def test_a_thrown_ball_is_where_it_flies(
    chromium: browser.Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, axes: int
):
    monkeypatch.chdir(tmp_path)
    Path("throw.yaml").write_text(THROWN[axes])
    assert app.run(["render", "throw.yaml", "-o", "throw.wav", "--motion"]) == 0
    server = _core.ViewServer(tmp_path / "throw.motion")
    try:
        with chromium.page(640, 360) as page:
            page.open(f"{server.url}?t=0.1")
            n = page.run("ergon.page.story.model.space.length")
            assert n == 2  # the nail and the ball
            ball = page.run(
                "ergon.page.story.model.space.findIndex((axes) => "
                "ergon.page.story.model.nameOf(axes[0]) === 'throw.ball')"
            )
            assert ball >= 0
            found = []
            for t in (0.0, 0.25, 0.4):
                page.run(f"ergon.seek({t})")
                where = f"ergon.page.motion.where(ergon.page.story.model.space[{ball}][0])"
                found.append(page.run(f"Array.from({where})"))
            hidden = page.run(
                "ergon.page.story.model.space.flat().filter((p) => "
                "ergon.page.drawing.state.data[4 * p + 2] < 0).length"
            )
        times = np.array([0.0, 0.25, 0.4])
        height = 1.0 + times - 0.5 * 9.81 * times**2
        across = 0.1 + 0.2 * times
        exact = {2: [across, height], 3: [across, 0.3 * times, height]}[axes]
        along = {2: [0, 2], 3: [0, 1, 2]}[axes]
        origin = np.array(found)[0] - np.array([0.1, 0.0, 1.0])
        moved = (np.array(found) - origin)[:, along]
        np.testing.assert_allclose(moved, np.array(exact).T, atol=2e-3)  # to a look of the engine
        assert hidden == 2 * (axes - 1)
    finally:
        server.close()
