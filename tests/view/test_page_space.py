"""Points in space in a real browser: each is drawn once, where its coordinates say."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
from thrown import THROWN, places_of_ball

from ergon import _core
from ergon.cli import app


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
        exact = places_of_ball(times, axes)
        np.testing.assert_allclose(
            np.array(found) - found[0], exact - exact[0], atol=2e-3
        )  # to a look of the engine
        assert hidden == 2 * (axes - 1)
    finally:
        server.close()
