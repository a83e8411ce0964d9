"""What the page shows at first sight: views that fill the window, labels, light for a projector."""

from __future__ import annotations

from collections.abc import Iterator

import browser
import numpy as np
import pytest
from motions import CELLS, WIRE, Piece

from ergon import _core

# Where points of the model are in the picture, from its left and its top, in shares of it.
SEEN = """(() => {
  const {model} = ergon.page.story, m = ergon.page.view.matrix, found = [];
  for (let p = 0; p < model.n; p++) {
    const [x, y, z] = [model.x[p], model.y[p], model.z[p]];
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    found.push([0.5 + 0.5 * (m[0] * x + m[4] * y + m[8] * z + m[12]) / w,
                0.5 - 0.5 * (m[1] * x + m[5] * y + m[9] * z + m[13]) / w, w]);
  }
  return found;
})()"""
BOXES = """[...document.querySelectorAll("#labels span:not([hidden])")].map((one) => {
  const {left, top, right, bottom} = one.getBoundingClientRect();
  return [one.textContent, left, top, right, bottom];
})"""
# The greatest relative luminance (WCAG 2.2) within 2 pixels of places in the picture.
LIGHT = """((points) => {
  ergon.page.one(%s);
  const {gl} = ergon.page.drawing, w = gl.drawingBufferWidth, h = gl.drawingBufferHeight;
  const a = new Uint8Array(4 * w * h);
  const linear = (v) => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, a);
  return points.map(([u, v]) => {
    let most = 0;
    for (let x = -2; x <= 2; x++) for (let y = -2; y <= 2; y++) {
      const i = 4 * (w * Math.round((1 - v) * h + y) + Math.round(u * w + x));
      const [r, g, b] = [a[i], a[i + 1], a[i + 2]].map(linear);
      most = Math.max(most, 0.2126 * r + 0.7152 * g + 0.0722 * b);
    }
    return most;
  });
})"""


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    motion = Piece().write(tmp_path_factory.mktemp("motion") / "example.motion")
    server = _core.ViewServer(motion, key=browser.KEY)
    yield server.url
    server.close()


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running() as found:
        yield found


@pytest.mark.parametrize(
    "size",
    [
        (500, 900),
        pytest.param((1280, 720), marks=pytest.mark.slow),
        pytest.param((640, 640), marks=pytest.mark.slow),
    ],
)
def test_page_first_view_fills_any_window_shape(
    chromium: browser.Browser, url: str, size: tuple[int, int]
) -> None:
    with chromium.page(*size) as page:
        page.open(f"{url}?t=0")
        seen = np.array(page.run(SEEN))
    assert (seen[:, 2] > 0).all()
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    assert (low > 0.05).all()
    assert (high < 0.95).all()
    assert ((high - low) / (0.86, 0.76)).max() == pytest.approx(1.0, abs=0.01)


def test_page_labels_without_overlap(chromium: browser.Browser, url: str) -> None:
    with chromium.page(1280, 720) as page:
        page.open(f"{url}?t=1.4")
        for view in range(4):
            page.run(f"ergon.page.preset({view}); ergon.page.one(1.4)")
            boxes = page.run(BOXES)
            assert len(boxes) >= 7
            for i, (name, left, top, right, bottom) in enumerate(boxes):
                for other, a, b, c, d in boxes[:i]:
                    across = min(right, c) - max(left, a)
                    down = min(bottom, d) - max(top, b)
                    assert across <= 2 or down <= 3, (view, name, other)


def test_page_contrast_of_resting_points(chromium: browser.Browser, url: str) -> None:
    """Contrast by WCAG 2.2 against the background: what rests at the beginning is seen, on a
    screen by 1.4.11 and by a projector as words of 1.4.3.
    """
    with chromium.page(1280, 720) as page:
        page.open(f"{url}?t=0")
        seen = np.array(page.run(SEEN))[:, :2]
        rests = [*range(0, CELLS, 3), *range(CELLS + WIRE, len(seen), 3)]  # the wire is bent
        points = seen[rests].tolist()
        plain = np.array(page.run(f"{LIGHT % 0}({points})"))
        page.run("ergon.page.look.projector = true")
        bright = np.array(page.run(f"{LIGHT % 0}({points})"))
        page.open(f"{url}?t=0&projector")
        assert page.run("ergon.page.look.projector")
    ground = 0.2126 * 0.012 / 12.92 + 0.7152 * 0.016 / 12.92 + 0.0722 * 0.03 / 12.92
    assert (plain + 0.05).min() / (ground + 0.05) >= 3.0
    assert (bright + 0.05).min() / (ground + 0.05) >= 4.5


def test_page_dome_view_with_loudspeakers(chromium: browser.Browser, url: str) -> None:
    with chromium.page(1280, 720) as page:
        page.open(f"{url}?t=0")
        page.run("ergon.page.preset(1); ergon.page.one(0)")
        boxes = [box for box in page.run(BOXES) if box[0].startswith("S")]
    seen = [box for box in boxes if 0 < box[1] < 1280 and 0 < box[2] < 660]
    assert len(seen) >= 8
