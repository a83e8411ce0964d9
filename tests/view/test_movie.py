"""Films of the page: each picture is that of its instant, and the sound goes with it."""

from __future__ import annotations

import wave
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import av
import browser
import numpy as np
import pytest
from commands import forked
from motions import Piece
from numpy.typing import NDArray
from sweep import few

from ergon.api.errors import OptionError
from ergon.api.pages import ANY_LOCAL_PORT, serve
from ergon.api.viewing import Shown
from ergon.common.errors import ErgonError
from ergon.common.report import Report
from ergon.exchange.safe import FileRefusedError
from ergon.workshop.api.movie import MovieMaker, MovieOptions
from ergon.workshop.movies.chromium import BrowserError

SIZE, FPS = (320, 180), 5
SMALL = MovieOptions(size="320x180", rate=FPS)
RATE, TONE = 32_000, 1_000.0  # Hz
BEGINS = 1.5  # [s] of the file until its tone begins


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    folder = tmp_path_factory.mktemp("piece")
    n = round(4 * RATE)
    t = np.arange(n) / RATE
    tone = np.where(t < BEGINS, 0.0, 8000 * np.sin(2 * np.pi * TONE * t))
    with wave.open(str(folder / "tone.wav"), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(RATE)
        file.writeframes(np.repeat(tone, 2).astype("<i2").tobytes())
    return Shown(Piece().write(folder / "piece.motion"), folder / "tone.wav")


@pytest.fixture(scope="module")
def page(shown: Shown) -> Iterator[browser.Page]:
    server = serve(ANY_LOCAL_PORT, "at", Report(), shown.motion)
    try:
        with browser.running() as raised, raised.page(*SIZE) as page:
            page.open(f"{server.url}?t=0&stage")
            yield page
    finally:
        server.close()


def pixels(png: bytes) -> NDArray[np.float64]:
    (frame,) = av.CodecContext.create("png", "r").decode(av.Packet(png))
    return frame.to_ndarray(format="rgb24").astype(float)


def test_movie_pictures_equal_page_at_instants(
    shown: Shown, page: browser.Page, tmp_path: Path
) -> None:
    asked = replace(SMALL, start="1s", end="2s", camera="4")
    built = MovieMaker(f"{tmp_path}/film/", asked).make(shown)
    files = sorted((tmp_path / "film").iterdir())
    assert [file.name for file in files] == [f"{i:06}.png" for i in range(FPS)]
    assert (built.n_pictures, built.seconds, built.has_sound) == (FPS, 1.0, False)
    page.press("4")
    for i, file in enumerate(files):
        page.run(f"ergon.seek({1 + i / FPS})")
        assert file.read_bytes() == page.picture()


@pytest.mark.parametrize("suffix", [".webm", pytest.param(".mp4", marks=pytest.mark.slow)])
def test_movie_file_with_pictures_and_sound(shown: Shown, tmp_path: Path, suffix: str) -> None:
    asked = replace(SMALL, start="1s", end="3s")
    target = tmp_path / f"film{suffix}"
    built = MovieMaker(target, asked).make(shown)
    assert (built.n_pictures, built.seconds, built.has_sound) == (2 * FPS, 2.0, True)
    MovieMaker(f"{tmp_path}/film/", asked).make(shown)
    wanted = [pixels(file.read_bytes()) for file in sorted((tmp_path / "film").iterdir())]
    with av.open(target) as file:
        frames = list(file.decode(video=0))
    assert [round(frame.time, 3) for frame in frames] == [i / FPS for i in range(2 * FPS)]
    result = [frame.to_ndarray(format="rgb24").astype(float) for frame in frames]
    # Of all pictures that of its own instant is the nearest.
    for i, picture in enumerate(result):
        assert picture.shape == (SIZE[1], SIZE[0], 3)
        assert int(np.argmin([np.abs(picture - other).mean() for other in wanted])) == i
    with av.open(target) as file:
        listened = [frame.to_ndarray()[0] for frame in file.decode(audio=0)]
        rate = file.streams.audio[0].rate
    sound = np.concatenate(listened)
    assert len(sound) / rate == pytest.approx(2.0, abs=0.05)
    assert np.abs(sound[: round(0.45 * rate)]).max() < 0.01
    loud = sound[round(0.55 * rate) : round(1.55 * rate)]
    assert np.abs(loud).max() == pytest.approx(8000 / 32768, rel=0.05)
    assert np.argmax(np.abs(np.fft.rfft(loud))) * rate / len(loud) == pytest.approx(TONE, abs=2)


def test_movie_camera_travel_between_views(page: browser.Page) -> None:
    assert page.run("ergon.page.travel([[1, 0], [3, 3]])") is None
    list_of = "({target, distance, yaw, pitch}) => [...target, distance, yaw, pitch]"
    looks = page.run(f"ergon.page.presets.map({list_of})")
    position = f"({list_of})(ergon.page.camera)"
    for t, wanted in ((0.2, looks[0]), (1.0, looks[0]), (3.0, looks[3]), (3.7, looks[3])):
        page.run(f"ergon.seek({t})")
        assert page.run(position) == wanted
    page.run("ergon.seek(2)")
    *target, distance, yaw, pitch = page.run(position)
    a, b = np.array(looks[0]), np.array(looks[3])
    np.testing.assert_allclose([*target, yaw, pitch], np.delete((a + b) / 2, 3), atol=1e-12)
    assert distance == pytest.approx(np.sqrt(a[3] * b[3]))
    assert page.run("ergon.page.travel([[0, 99]])") == len(looks)


def test_view_movie_option_writes_film(shown: Shown, tmp_path: Path) -> None:
    target = tmp_path / "film.webm"
    sizes = ["--size", "64x64", "--fps", "2", "--from", "1s", "--until", "2s"]
    arguments = ["view", str(shown.motion), "--sound", str(shown.sound), "--movie", str(target)]
    done = forked([*arguments, *sizes], tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"{target}: 2 pictures of 64x64, 1 s, with sound" in done.stderr
    target.write_bytes(target.read_bytes() + b"edited")
    again = forked([*arguments, *sizes], tmp_path)
    assert again.returncode == 2
    assert "no record of writing it as it is now; -f overwrites it" in again.stderr
    lost = forked(["view", str(shown.motion), "--fps", "2"], tmp_path)
    assert lost.returncode == 2
    assert "--fps needs --movie" in lost.stderr


REFUSED = {
    "an odd side": (replace(SMALL, size="321x180"), "write two even numbers"),
    "no size": (replace(SMALL, size="large"), "write two even numbers"),
    "no rate": (replace(SMALL, rate=0), "1 to 120 pictures a second"),
    "no view": (replace(SMALL, camera="0"), "write views and when they are reached"),
    "views without times": (replace(SMALL, camera="1 2"), "write views and when they are reached"),
    "back in time": (replace(SMALL, camera="1@4s 2@1s"), "reached later than the one before"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_movie_refuses_wrong_options(name: str, tmp_path: Path) -> None:
    options, sentence = REFUSED[name]
    with pytest.raises(OptionError, match=sentence):
        MovieMaker(tmp_path / "film.webm", options)


def test_movie_refuses_wrong_file_names(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"films end in \.webm, \.mp4; a name that ends in /"):
        MovieMaker(tmp_path / "film.avi", SMALL)
    (tmp_path / "mine.webm").write_text("mine")
    with pytest.raises(FileRefusedError, match="no record of writing it"):
        MovieMaker(tmp_path / "mine.webm", SMALL)
    with pytest.raises(OptionError, match="is not an empty folder"):
        MovieMaker(tmp_path, SMALL)


STRETCHES = {
    "beyond the end": ("9s", None, "the piece ends at 4.00 s"),
    "backwards": ("2s", "1s", "after its beginning"),
    "no mark": ("coda", None, "write seconds such as 90s or a mark: "),
}


@pytest.mark.parametrize("name", few(STRETCHES, 1))
def test_movie_of_interval_outside_piece_is_refused(
    name: str, shown: Shown, tmp_path: Path
) -> None:
    start, end, sentence = STRETCHES[name]
    maker = MovieMaker(tmp_path / "film.webm", replace(SMALL, start=start, end=end))
    with pytest.raises(OptionError, match=sentence):
        maker.make(shown)
    assert list(tmp_path.iterdir()) == []


def test_movie_with_ended_browser_leaves_no_file(shown: Shown, tmp_path: Path) -> None:
    maker = MovieMaker(tmp_path / "film.webm", replace(SMALL, browser="true"))
    with pytest.raises(BrowserError, match="the browser has ended"):
        maker.make(shown)
    with pytest.raises(ErgonError, match="there is no program nowhere"):
        MovieMaker(tmp_path / "film.webm", replace(SMALL, browser="nowhere"))
    assert list(tmp_path.iterdir()) == []
