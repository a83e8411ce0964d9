"""Points in space in a real browser: drawn once, where they are; springs between them break."""

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
def test_page_thrown_ball_position(
    chromium: browser.Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, axes: int
):
    monkeypatch.chdir(tmp_path)
    Path("throw.yaml").write_text(THROWN[axes])
    assert app.run(["render", "throw.yaml", "-o", "throw.wav", "--motion"]) == 0
    server = _core.ViewServer(tmp_path / "throw.motion", key=browser.KEY)
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
            result = []
            for t in (0.0, 0.25, 0.4):
                page.run(f"ergon.seek({t})")
                where = f"ergon.page.motion.where(ergon.page.story.model.space[{ball}][0])"
                result.append(page.run(f"Array.from({where})"))
            hidden = page.run(
                "ergon.page.story.model.space.flat().filter((p) => "
                "ergon.page.drawing.state.data[4 * p + 2] < 0).length"
            )
        times = np.array([0.0, 0.25, 0.4])
        exact = places_of_ball(times, axes)
        np.testing.assert_allclose(
            np.array(result) - result[0], exact - exact[0], atol=2e-3
        )  # to a look of the engine
        assert hidden == 2 * (axes - 1)
    finally:
        server.close()


TORN = """\
ergon: 1
instruments:
  w:
    space: 3
    modules:
      nail: {SOL: {X0: [0, 0, 0]}}
      ball: {MAS: {M: 1kg, X0: [10cm, 0, 0], V0: [0.4m/s, 0, 0]}}
      other: {MAS: {M: 1kg, X0: [0, 0, 10cm], V0: [0, 0, 0.1m/s]}}
      thread: {REF: {between: [nail, ball], K: 1kN/m%s}}
      rope: {REF: {between: [nail, other], K: 1kN/m, breaks: 8mm}}
    out: {x: {SOX: ball.x}, z: {SOX: other.z}}
render: {tail: 1.5s}
"""
# Half way to the ball, how bright the picture is where nothing but a spring is drawn.
MIDDLE = """(() => {
  const { drawing, motion, story } = ergon.page, { gl } = drawing, m = drawing.always.M;
  const at = story.model.space.map((axes) => motion.where(axes[0]));
  const [nail, ball] = [0, 1].map((i) => at[i]);
  const [x, y, z] = nail.map((v, i) => (v + ball[i]) / 2);
  const clip = [0, 1, 3].map((i) => m[i] * x + m[4 + i] * y + m[8 + i] * z + m[12 + i]);
  const [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const px = [w, h].map((n, i) => Math.floor((clip[i] / clip[2] / 2 + 0.5) * n));
  const rgb = new Uint8Array(4 * 49);
  gl.readPixels(px[0] - 3, px[1] - 3, 7, 7, gl.RGBA, gl.UNSIGNED_BYTE, rgb);
  return Math.max(...rgb.filter((_, i) => i % 4 < 3));
})()"""


def test_page_hides_broken_spring(
    chromium: browser.Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    light = {}
    for name, breaks in (("whole", ""), ("torn", ", breaks: 8mm")):
        Path(f"{name}.yaml").write_text(TORN % breaks)
        assert app.run(["render", "-q", f"{name}.yaml", "-o", f"{name}.wav", "--motion"]) == 0
        server = _core.ViewServer(tmp_path / f"{name}.motion", key=browser.KEY)
        try:
            with chromium.page(640, 360) as page:
                page.open(f"{server.url}?t=0.01")
                # It breaks after 22 ms. Going back it is whole again.
                for t in (0.01, 0.1, 1.4, 0.015):
                    page.run(f"ergon.seek({t})")
                    light[name, t] = page.run(MIDDLE)
        finally:
            server.close()
    background = light["torn", 0.1]
    assert background < 10
    assert {at for at, seen in light.items() if seen > 3 * background} == {
        *(("whole", t) for t in (0.01, 0.1, 1.4, 0.015)),
        *(("torn", t) for t in (0.01, 0.015)),
    }, light


SURFACE = """\
ergon: 1
instruments:
  w:
    space: 3
    modules:
      ball: {MAS: {M: 20g, X0: [2cm, 0, 3cm], V0: [0, 0, -1m/s]}}
      skin: {SURFACE: {of: drum.all, at: [1cm, 0], across: 20cm}}
      hit: {BUT: {between: [ball, skin.all], K: 2kN/m, gap: 2cm}}
      tie: {RES: {between: [ball, skin.3], K: 1N/m}}
  drum:
    PLATE: {shape: disc, radius: 3, M: 50g, f: 90Hz, t60: 2s, rim: fixed}
    out: {SOV: drum.0}
render: {tail: 0.5s}
"""


def test_page_plate_drawn_at_its_surface(
    chromium: browser.Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its masses are drawn there, exaggerated as without a surface; a tie ends at one of them."""
    monkeypatch.chdir(tmp_path)
    Path("drum.yaml").write_text(SURFACE)
    assert app.run(["render", "-q", "drum.yaml", "-o", "drum.wav", "--motion"]) == 0
    server = _core.ViewServer(tmp_path / "drum.motion", key=browser.KEY)
    try:
        with chromium.page(640, 360) as page:
            page.open(f"{server.url}?t=0.03")
            page.run("ergon.seek(0.03)")
            points = page.run(
                "(({story, motion}) => story.model.space.map((axes) => [story.model.nameOf("
                "axes[0]), story.model.drawn[axes[0]], axes.at(-1), ...motion.where(axes.at(-1)), "
                "story.model.x[axes[0]], motion.light[axes.at(-1)]])"
                ")(ergon.page)"
            )
            gains = page.run(
                "(({story, motion}) => story.model.parts.map((part, i) => "
                "[part.name, motion.exaggeration(i)]))(ergon.page)"
            )
            links = page.run("Array.from(ergon.page.story.model.links)")
    finally:
        server.close()
    ball = next(point for point in points if point[0] == "w.ball")
    masses = [point for point in points if point[0].startswith("w.skin")]
    assert len(masses) == 19
    assert all(point[1] == point[2] for point in masses)
    assert dict(gains)["w"] == 1.0 < dict(gains)["drum"]
    wide = np.ptp([point[3] for point in masses])
    assert 0.13 < wide < 0.2  # without the rim, which is held
    middle = np.mean([point[3] for point in masses])
    assert abs(middle - (ball[6] - 1e-2)) < 1e-6  # of where the ball begins
    assert max(point[7] for point in masses) > 0.1  # it rings
    tied = masses[3][2]
    assert any(
        tied in pair for pair in zip(links[::2], links[1::2], strict=True) if ball[1] in pair
    )
