"""What a written gesture strikes, in a real browser: each spark meets its key at its instant."""

from __future__ import annotations

from pathlib import Path

import browser
import numpy as np
import pytest
from motion_reader import ERGON, ERGONS, Replica
from one_bell import SCORE

from ergon import _core
from ergon.cli import app

WIDTH, HEIGHT = 640, 360
# What is lit where the key is, and above and below it: brightness by rows, down from the top.
ROWS = """(() => {
  const { drawing, motion, story } = ergon.page, { gl } = drawing;
  const m = drawing.always.M, [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const [x, y, z] = motion.where(%d);
  const [a, b, c] = [0, 1, 3].map((i) => m[i] * x + m[4 + i] * y + m[8 + i] * z + m[12 + i]);
  const [i, j] = [((a / c + 1) * w) / 2, ((1 - b / c) * h) / 2];
  const pixels = new Uint8Array(4 * w * h);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const rows = Array.from({ length: h }, (_, row) => {
    let sum = 0;
    for (let u = Math.max(0, Math.round(i) - 8); u < Math.min(w, i + 8); u++) {
      const at = 4 * ((h - 1 - row) * w + u);
      sum += Math.max(0, pixels[at] + pixels[at + 1] - 30);
    }
    return sum;
  });
  return [j, rows];
})()"""


@pytest.fixture
def film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("bell.yaml").write_text(SCORE)
    assert app.run(["render", "-q", "bell.yaml", "-o", "bell.wav", "--motion"]) == 0
    return Path("bell.motion")


def test_page_sparks_meet_key_by_sign(film: Path) -> None:
    replica = Replica(film.read_bytes())
    key = replica.names.index("k1")
    output = [
        (t + float(e["dt"]), float(e["impulse"]))
        for t, all_ in replica.records(ERGONS, ERGON)
        for e in all_
        if e["point"] == key
    ]
    greatest = max(abs(impulse) for _, impulse in output)
    server = _core.ViewServer(film, key=browser.KEY)
    checked = set()
    try:
        with browser.running() as chromium, chromium.page(WIDTH, HEIGHT) as page:
            page.open(f"{server.url}?t=0.1")
            page.run(
                "const { camera, clock, drawing, story } = ergon.page, { x, y, z } = story.model;"
                "for (const k in drawing.show) drawing.show[k] = k === 'sparks';"
                f"const target = [x[{key}], y[{key}], z[{key}]];"
                "camera.look({ target, distance: 1.5, yaw: 0, pitch: 0.1 });"
                "clock.slow = 9"  # a thousandth of the speed: no other spark is near
            )

            def middle(t: float) -> float:
                """How far what is lit on the vertical of the key is below it [px]."""
                page.run(f"ergon.seek({t!r})")
                position, rows = page.run(ROWS % key)
                rows = np.array(rows, float)
                assert rows.sum() > 100, t
                return float((rows * (np.arange(HEIGHT) + 0.5)).sum() / rows.sum() - position)

            for t, impulse in output:
                if abs(impulse) < 0.01 * greatest:
                    continue
                assert abs(middle(t)) < 2.0, t
                # Before, it is below the key if it pushes up.
                assert np.sign(middle(t - 3e-4)) == np.sign(impulse), t
                assert np.sign(middle(t + 1e-4)) == np.sign(impulse), t
                checked.add(np.sign(impulse))
            # What is a hundred thousand times weaker than the strongest is not drawn.
            for t, impulse in output:
                if abs(impulse) < 1e-5 * greatest:
                    page.run(f"ergon.seek({t!r})")
                    assert sum(page.run(ROWS % key)[1]) == 0, t
    finally:
        server.close()
    assert checked == {1.0, -1.0}
