"""The page in a real browser: it draws exactly the instant that it is asked for."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import browser
import numpy as np
import pytest
from motions import CELLS, SECONDS, Piece, chunk
from numpy.typing import NDArray
from patience import until

from ergon import _core

WIDTH, HEIGHT = 640, 360
PIECE = Piece()

# Whether a pixel is lit, and the middle of those of a colour, of what was drawn last.
PIXELS = """(() => {
  const {gl} = ergon.page.drawing, w = gl.drawingBufferWidth, h = gl.drawingBufferHeight;
  const a = new Uint8Array(4 * w * h);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, a);
  return {a, w, h};
})()"""
LIT = f"""(() => {{ const {{a}} = {PIXELS}; let n = 0;
  for (let i = 0; i < a.length; i += 4) if (a[i] + a[i + 1] + a[i + 2] > 60) n++;
  return n; }})()"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[browser.Browser]:
    with browser.running() as found:
        yield found


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return PIECE.write(tmp_path_factory.mktemp("motion") / "example.motion")


@pytest.fixture(scope="module")
def url(motion: Path) -> Iterator[str]:
    server = _core.ViewServer(motion, key=browser.KEY)
    yield server.url
    server.close()


@pytest.fixture
def page(chromium: browser.Browser, url: str) -> Iterator[browser.Page]:
    with chromium.page(WIDTH, HEIGHT) as page:
        page.open(f"{url}?t=1.4")
        yield page


def seek(page: browser.Page, t: float) -> None:
    page.run(f"ergon.seek({t!r})")


def projected(page: browser.Page, xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where a place [m] is [px], by the page's matrix."""
    m = np.array(page.run("Array.from(ergon.page.view.matrix)")).reshape(4, 4)
    x, y, _, w = np.append(xyz, 1.0) @ m
    return np.array([(x / w + 1) / 2 * WIDTH, (1 - y / w) / 2 * HEIGHT])


def alone(page: browser.Page, what: str) -> None:
    """Draws one kind of thing."""
    page.run(
        f"for (const k in ergon.page.drawing.show) ergon.page.drawing.show[k] = k === '{what}'"
    )


def middle(page: browser.Page, near: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """The middle of what is lit around a place [px], by brightness."""
    x, y, total = page.run(
        f"""(() => {{ const {{a, w, h}} = {PIXELS}; let x = 0, y = 0, s = 0;
        for (let j = 0; j < h; j++) for (let i = 0; i < w; i++) {{
          const u = i + .5, v = h - j - .5;
          if (Math.hypot(u - {near[0]}, v - {near[1]}) > {radius}) continue;
          const at = 4 * (j * w + i), b = Math.max(0, a[at] + a[at + 1] - 30);
          x += b * u; y += b * v; s += b; }}
        return [x / s, y / s, s]; }})()"""
    )
    assert total > 100, "something is lit there"
    return np.array([x, y])


def test_page_loads_without_errors_or_external_requests(page: browser.Page, url: str) -> None:
    seek(page, 1.5)
    assert page.run(LIT) > 500
    assert page.errors == []
    single = (url, url.replace("http", "ws"))
    assert len(page.requests) > 20
    assert [asked for asked in page.requests if not asked.startswith(single)] == []
    assert page.run("document.title") == "Example: view"


def test_page_loudspeaker_labels_and_levels(page: browser.Page) -> None:
    page.press("4")
    seek(page, 2.0)
    result = page.run(
        "[...document.querySelectorAll('#labels .speaker')].filter((e) => !e.hidden)"
        ".map((e) => [e.textContent, +e.dataset.level])"
    )
    assert [name for name, _ in result] == [f"S{i + 1}" for i in range(24)]
    # In tenths of a decibel.
    wanted = [20 * np.log10(PIECE.level(i, 2.0)) for i in range(24)]
    np.testing.assert_allclose([level for _, level in result], wanted, atol=0.051)
    page.press("v")
    seek(page, 2.0)
    items = page.run("[...document.querySelectorAll('#levels li')].map((e) => e.textContent)")
    assert items[0] == f"S1 {wanted[0]:.0f} dB"
    assert len(items) == 24


def test_page_point_positions_by_formula(page: browser.Page) -> None:
    """At six instants in any order; so slowly that nothing strobes."""
    page.run("ergon.page.clock.slow = 9")
    parts = [("sky", CELLS), ("wire", 40), ("disc", 60), ("plate", 50), ("keys", 2)]
    peaks = PIECE.peaks()
    for t in np.random.default_rng(2).uniform(0, SECONDS - 0.05, 6):
        seek(page, float(t))
        result = np.array(page.run("Array.from(ergon.page.motion.z)"))
        wanted = PIECE.displacement(float(t))
        for (name, n), peak in zip(parts, peaks, strict=True):
            position = slice(PIECE.first(name), PIECE.first(name) + n)
            off = np.abs(result[position] - wanted[position]).max()
            assert off < 5e-3 * peak, f"{name} at {t} s: {off} m of {peak} m"


def test_page_draws_fast_points_as_sweep(page: browser.Page) -> None:
    seek(page, 1.6)
    z, sweep = np.array(
        page.run("[Array.from(ergon.page.motion.z), Array.from(ergon.page.motion.sweep)]")
    )
    fast = PIECE.omega > 2 * np.pi * 25
    assert 0.5 < fast.mean() < 1
    assert (z[:CELLS][fast] == 0).all()
    assert (sweep[:CELLS][~fast] == 0).all()
    # No displacement of a period is beyond the sweep, and one comes near to it.
    loudest = int(np.argmax(sweep[:CELLS]))
    period = 2 * np.pi / PIECE.omega[loudest]
    largest = max(
        abs(PIECE.displacement(1.6 + period * (k / 40 - 0.5))[loudest]) for k in range(40)
    )
    assert largest == pytest.approx(sweep[loudest], rel=0.02)


def test_page_spark_at_target_at_its_instant(page: browser.Page) -> None:
    alone(page, "sparks")
    page.run("ergon.page.clock.slow = 9")  # so that no other is near, and cells go slowly
    for e in PIECE.ergons[5:400:40]:
        seek(page, e.t)
        factor = page.run("ergon.page.motion.exaggeration(0)")
        z = PIECE.displacement(e.t)[e.point]
        xyz = PIECE.xyz[:, e.point] + [0, 0, factor * z]
        wanted = projected(page, xyz)
        assert np.hypot(*(middle(page, wanted, 12) - wanted)) < 2, e


@pytest.mark.parametrize("sign", [-1, 1])
def test_page_spark_path_before_and_after_impact(page: browser.Page, sign: int) -> None:
    alone(page, "sparks")
    e = next(e for e in PIECE.ergons[10:] if np.sign(e.impulse) == sign)
    target = PIECE.xyz[:, e.point].tolist()
    look = f"{{target: {target}, distance: 1.5, yaw: 0, pitch: 0.1}}"
    page.run(f"ergon.page.clock.slow = 9; ergon.page.camera.look({look})")
    # Time goes by a thousandth, and so a millisecond is a metre of the picture.
    for early in (4e-4, 2e-4, 0.0, -2e-4):
        t = e.t - early
        seek(page, t)
        factor = page.run("ergon.page.motion.exaggeration(0)")
        z = factor * PIECE.displacement(t)[e.point] - sign * abs(early) * 1000
        wanted = projected(page, PIECE.xyz[:, e.point] + [0, 0, z])
        assert np.hypot(*(middle(page, wanted, 12) - wanted)) < 3, (e, early)


def test_page_point_details_under_pointer(page: browser.Page) -> None:
    e = next(e for e in PIECE.ergons if e.point < CELLS)
    seek(page, e.t + 0.01)
    factor = page.run("ergon.page.motion.exaggeration(0)")
    z = page.run(f"ergon.page.motion.z[{e.point}]")
    x, y = projected(page, PIECE.xyz[:, e.point] + [0, 0, factor * z])
    page.run("for (let i = 1; i < 5; i++) ergon.page.look.seen[i] = 0")
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    seek(page, e.t + 0.01)
    output = page.run("document.getElementById('point').textContent")
    lines = output.split("\n")
    assert lines[0] == PIECE.name(e.point)
    f = PIECE.omega[e.point] / (2 * np.pi)
    value, unit = lines[1].removeprefix("f ").split(" ")
    assert float(value) * {"Hz": 1, "kHz": 1000}[unit] == pytest.approx(f, rel=5e-3)
    assert f"{e.t:.3f} s" in output
    assert lines[-1] == "rain, example.yaml:12"


def test_page_details_of_unstruck_point(page: browser.Page) -> None:
    first = min(e.t for e in PIECE.ergons if e.point < CELLS)
    seek(page, first / 2)
    point = next(e.point for e in PIECE.ergons if e.point < CELLS)
    page.run(f"ergon.page.inspected = {point}")
    seek(page, first / 2)
    lines = page.run("document.getElementById('point').textContent").split("\n")
    assert "at rest" in lines
    assert not [line for line in lines if "?" in line or "±" in line]


def test_page_frame_rate_display(page: browser.Page) -> None:
    bar = "document.getElementById('bar').textContent"
    page.run("ergon.page.look.frameRate = true; ergon.page.play(true); ergon.page.clock.slow = 3")
    until(lambda: re.search(r"\b[1-9]\d* pictures a second", page.run(bar)), "a rate")
    page.run("ergon.page.look.frameRate = false; ergon.page.changed()")
    until(lambda: "pictures" not in page.run(bar), "no rate")
    page.run("ergon.page.play(false)")


def test_page_keys_change_state(page: browser.Page) -> None:
    def state() -> str:
        return page.run(
            "JSON.stringify([ergon.page.clock, ergon.page.camera, ergon.page.look,"
            "ergon.page.chosen, ergon.page.following, ergon.page.inspected,"
            "ergon.page.motion.locked, ergon.page.labels.shown, ergon.page.sound.wanted,"
            "ergon.page.alignment.ahead,"
            "document.getElementById('help').hidden, document.getElementById('levels').hidden])"
        )

    keys = page.run("ergon.page.controls.rows.map(([keys]) => keys[0])")
    assert len(keys) > 35
    idle = []
    page.run("ergon.page.clock.slow = 3")
    for key in [*keys, *"23456789"]:
        page.run("ergon.page.play(false); ergon.page.clock.t = 1.4; ergon.page.clock.from = 0.2")
        page.run("ergon.page.clock.loop = [0.1, 0.2]; ergon.page.help(); ergon.page.inspected = 7")
        page.run("ergon.page.following = 0; ergon.page.motion.lock(0, 10)")
        before = state()
        bare = key.removeprefix("Shift+")
        page.press(bare, shift=key != bare)
        if state() == before:
            idle.append(key)
    assert idle == []
    assert page.errors == []


def test_page_time_shift_shared_by_ports(chromium: browser.Browser, motion: Path) -> None:
    def opened(page: browser.Page) -> str:
        server = _core.ViewServer(motion, key=browser.KEY)
        try:
            page.open(f"{server.url}?t=1")
        finally:
            server.close()
        return page.run("ergon.page.alignment.told")

    with chromium.page() as page:
        assert opened(page) == "picture as it is computed"
        for key in ("'", "'", "'", ";"):
            page.press(key)
        output = "picture 10 ms earlier"
        assert page.run("document.getElementById('told').textContent") == output
        assert opened(page) == output
        page.run("ergon.page.alignment.shift(-0.01)")


def test_page_parts_hidden_dimmed_and_alone(page: browser.Page) -> None:
    seek(page, 1.5)
    page.run("for (const k of ['speakers', 'sparks']) ergon.page.drawing.show[k] = false")

    def lit() -> int:
        seek(page, 1.5)
        return page.run(LIT)

    complete = lit()
    page.press("z")
    sky = lit()
    assert 0 < sky < complete
    page.press("z")
    assert lit() == complete
    page.press("x")
    assert lit() < complete
    page.press("x")
    page.press("c")
    assert lit() < complete
    words = page.run("document.querySelector('#labels .part').textContent")
    assert words.startswith("sky ×")


def test_page_clock_speed_and_loop(page: browser.Page) -> None:
    """A clock that the test makes: nothing depends on how fast this machine draws."""
    script = """(async () => {
      const {Clock} = await import(new URL('clock.js', document.baseURI));
      const c = new Clock(); c.runs = true; const seen = [];
      c.tick(10, 4); c.tick(10.25, 4); seen.push(c.t);
      c.faster(-3); c.tick(10.35, 4); seen.push(c.t);
      c.faster(99); c.loop = [0, 0.5]; c.tick(10.75, 4); seen.push(c.t);
      c.noLoop(); c.t = 3.9; c.tick(11.1, 4); seen.push(c.t, c.runs);
      return seen; })()"""
    a, b, c, d, runs = page.run(script)
    assert (a, d, runs) == (0.25, 4, False)
    assert b == pytest.approx(0.26)
    assert c == pytest.approx(0.16)
    for _ in range(9):
        page.press("-")
    seek(page, 1.5)
    assert "×1/1000" in page.run("document.getElementById('bar').textContent")


def test_page_of_damaged_file_draws_valid_part(
    chromium: browser.Browser, motion: Path, tmp_path: Path
) -> None:
    complete = bytearray(motion.read_bytes())
    complete[3 * len(complete) // 4] ^= 1
    spoilt = tmp_path / "spoilt.motion"
    spoilt.write_bytes(complete)
    cut = tmp_path / "cut.motion"
    cut.write_bytes(motion.read_bytes()[: len(complete) // 2])
    newer = tmp_path / "newer.motion"
    newer.write_bytes(motion.read_bytes() + chunk(8, 4.0, b"", version=3))
    none = tmp_path / "none.motion"
    none.write_bytes(b"RIFF1234WAVEfmt ")
    output = {spoilt: "check sum", cut: "", newer: "version 3", none: "no .motion file"}
    for path, words in output.items():
        server = _core.ViewServer(path, key=browser.KEY)
        with chromium.page(WIDTH, HEIGHT) as page:
            page.call("Page.navigate", url=f"{server.url}?t=0.5")
            until(lambda: page.run("!!(window.ergon && ergon.ready)"), "the page")
            page.run("ergon.ready.catch(() => 0)")
            printed = page.run("document.getElementById('told').textContent")
            assert (words in printed) if words else printed == "", path.name
            if path is not none:
                assert page.run(LIT) > 200, path.name
        server.close()


STORM = 4000


def storm() -> bytes:
    """Cells all over the picture, each struck and touched at 1 s."""
    rng = np.random.default_rng(1)
    xyz = np.concatenate([rng.uniform(-1, 1, (2, STORM)), np.zeros((1, STORM))])
    part = {"name": "sky", "first": 0, "count": STORM, "kind": "sampled", "layout": "bank"}
    manifest = {
        **PIECE.manifest(),
        **{"points": STORM, "modes": 0, "speakers": [], "keys": [], "duration": 2.0},
        "parts": [part | {"why": None, "modes": None, "exaggeration": None}],
        "contacts": [{"name": f"c{i}", "a": i, "b": i} for i in range(STORM)],
    }
    rows = np.concatenate([xyz, np.zeros((1, STORM))]).astype("<f4").tobytes()
    contacts = np.zeros(STORM, [("t", "<f4"), ("i", "<u4"), ("f", "<f4")])
    contacts["i"], contacts["f"] = np.arange(STORM), 10
    ergons = np.zeros(STORM, [("t", "<f4"), ("p", "<u4"), ("i", "<f4"), ("v", "<f4"), ("s", "<u4")])
    ergons["t"], ergons["p"], ergons["i"] = 1, np.arange(STORM), -1e-3
    return b"".join(
        [
            b"ERGM\x02\0\0\0",
            chunk(1, 0, json.dumps(manifest).encode()),
            chunk(2, 0, STORM.to_bytes(4, "little") + rows + bytes(16 * STORM)),
            chunk(10, 0, b""),
            chunk(5, 0, ergons.tobytes()),
            chunk(6, 1, contacts.tobytes()),
        ]
    )


# The share of pixels whose relative luminance (WCAG 2) changes by a tenth or more, the darker state
# being below 0.8.
CHANGED = f"""(async () => {{
  const lin = (v) => (v /= 255) <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4;
  const look = () => {{ const {{a}} = {PIXELS}, l = [];
    for (let i = 0; i < a.length; i += 4)
      l.push(.2126 * lin(a[i]) + .7152 * lin(a[i + 1]) + .0722 * lin(a[i + 2]));
    return l; }};
  await ergon.seek(1.3); const before = look(); await ergon.seek(1); const after = look();
  const flashes = (l, i) => Math.abs(l - before[i]) >= .1 && Math.min(l, before[i]) < .8;
  return after.filter(flashes).length / after.length;
}})()"""


def test_page_flash_area_below_wcag_limit(chromium: browser.Browser, tmp_path: Path) -> None:
    """WCAG 2.3.1: a quarter of 341 × 256 px in 1024 × 768. What `--strobe` allows is more."""
    path = tmp_path / "storm.motion"
    path.write_bytes(storm())
    server = _core.ViewServer(path, key=browser.KEY)
    shares = {}
    for how in ("t=0", "t=0&strobe"):
        with chromium.page(WIDTH // 2, HEIGHT // 2) as page:  # shares are of any size
            page.open(f"{server.url}?{how}")
            page.press("3")
            page.run("ergon.page.camera.distance = 3")
            page.run("ergon.page.drawing.show.points = false")
            shares[how] = page.run(CHANGED)
    server.close()
    allowed = 341 * 256 / 4 / (1024 * 768)
    assert 0 < shares["t=0"] <= allowed
    assert shares["t=0&strobe"] > 2 * allowed


def test_page_contact_light_at_key_position(page: browser.Page) -> None:
    """Keys stand apart: half way between the two is nothing."""
    seek(page, 1.51)
    alone(page, "contacts")
    seek(page, 1.51)
    touched = PIECE.first("plate") + 25
    position = projected(page, np.array(page.run(f"ergon.page.motion.where({touched})")))
    assert np.abs(middle(page, position, 20) - position).max() < 1


def test_page_contrast_of_resting_keys(page: browser.Page) -> None:
    """A contrast of three to one with the background, as WCAG 1.4.11 asks of what is no text."""
    alone(page, "points")
    seek(page, 0.0)
    position = projected(
        page, np.array(page.run(f"ergon.page.motion.where({PIECE.first('keys')})"))
    )
    rgb = page.run(
        f"""(() => {{ const {{a, w, h}} = {PIXELS};
        const at = 4 * (Math.floor(h - {position[1]}) * w + Math.floor({position[0]}));
        return [a[at], a[at + 1], a[at + 2]]; }})()"""
    )
    assert luminance(rgb) / luminance((3, 4, 8)) > 3


def luminance(rgb: Sequence[float]) -> float:
    """Of a colour of sRGB, 0 to 255, with the light of a room (WCAG 2)."""
    share = np.array(rgb) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722)) + 0.05


def test_page_with_reduced_motion_starts_paused(chromium: browser.Browser, url: str) -> None:
    with chromium.page(WIDTH, HEIGHT) as page:
        page.call(
            "Emulation.setEmulatedMedia",
            features=[{"name": "prefers-reduced-motion", "value": "reduce"}],
        )
        page.open(url)
        assert page.run("ergon.page.clock.runs") is False
        alone(page, "contacts")
        seek(page, 1.51)
        assert page.run(LIT) == 0
    with chromium.page(WIDTH, HEIGHT) as page:
        page.open(url)
        assert page.run("ergon.page.clock.runs") is True
        alone(page, "contacts")
        seek(page, 1.51)
        assert page.run(LIT) > 0


def test_page_in_stage_mode_and_lost_connection(chromium: browser.Browser, motion: Path) -> None:
    server = _core.ViewServer(motion, key=browser.KEY)
    place = server.url.removeprefix("http://").split("/")[0]
    with chromium.page(WIDTH, HEIGHT) as page:
        page.open(f"{server.url}?t=1.5&stage")
        shown = "(id) => getComputedStyle(document.getElementById(id)).display"
        for name in ("labels", "bar", "told", "timeline"):
            assert page.run(f"({shown})('{name}')") == "none", name
        assert page.run("getComputedStyle(document.body).cursor") == "none"
        assert page.run(LIT) > 500
        until(lambda: page.run("ergon.page.isLost") is False, "a connection")
        server.close()
        until(lambda: page.run("ergon.page.isLost") is True, "its loss")
        until(lambda: page.run(LIT) == 0, "black")
        again = _core.ViewServer(motion, address=place, key=browser.KEY)
        until(lambda: page.run("!!window.ergon?.page && ergon.page.isLost === false"), "it is back")
        until(lambda: page.run(LIT) > 500, "the picture")
        again.close()


def test_page_opens_with_key_in_address(chromium: browser.Browser, motion: Path) -> None:
    server = _core.ViewServer(motion, address="0.0.0.0:0", key=browser.KEY)
    assert server.url.endswith(f"/{browser.KEY}/")
    with chromium.page(WIDTH, HEIGHT) as page:
        page.open(f"{server.url}?t=1.5")
        assert page.run(LIT) > 500
        until(lambda: server.tally["viewers"] == 1, "a viewer")
        assert page.errors == []
    server.close()
    with pytest.raises(_core.EngineError, match="32 hexadecimal digits"):
        _core.ViewServer(motion, address="0.0.0.0:0", key="0")


def test_page_switches_between_file_and_live_server(
    chromium: browser.Browser, motion: Path
) -> None:
    """Another server on the port of the last: the page that is open shows what is there."""
    server = _core.ViewServer(motion, key=browser.KEY)
    position = server.url.removeprefix("http://").split("/")[0]
    kind = """window.ergon && ergon.page.connection.offset !== null
      && [ergon.page.live !== null, window.before === true]"""
    try:
        with chromium.page(320, 240) as page:  # which is drawn all the time
            page.open(server.url)
            until(lambda: page.run(kind) == [False, False], "the file")
            for other in (None, motion):
                page.run("window.before = true")
                # The clock of a server begins with it, and a page tells servers apart by a second.
                page.run("new Promise((go) => setTimeout(go, 1200))")
                server.close()
                server = _core.ViewServer(other, address=position, key=browser.KEY)
                until(lambda is_live=other is None: page.run(kind) == [is_live, False], "the other")
            until(lambda: page.run("ergon.page.story.model !== null"), "the file is read")
            assert page.run("ergon.page.story.duration") == pytest.approx(SECONDS)
    finally:
        server.close()
