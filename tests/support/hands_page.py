"""The page of keys in a real browser, and what its pointers and letters do."""

from __future__ import annotations

import browser
from patience import until


class HandsPage:
    """The page with its lanes."""

    def __init__(self, page: browser.Page, url: str, lanes: int = 2) -> None:
        self.page = page
        self.show()
        page.call("Page.navigate", url=f"{url}hands.html")
        until(lambda: len(self.sentences()) == lanes, f"{lanes} lanes")
        until(lambda: all("stand-in" in text for text in self.sentences()), "a connection")

    def show(self) -> None:
        """Bring it to the front: a browser draws no hidden page."""
        self.page.call("Page.bringToFront")

    def sentences(self) -> list[str]:
        script = "[...document.querySelectorAll('figcaption')].map((it) => it.textContent)"
        texts: list[str] = self.page.run(script)
        return texts

    def middle(self, lane: int) -> tuple[float, float]:
        box = self.page.run(
            f"document.querySelectorAll('#hands canvas')[{lane}].getBoundingClientRect().toJSON()"
        )
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def mouse(self, kind: str, x: float, y: float) -> None:
        self.page.call(
            "Input.dispatchMouseEvent",
            type=kind,
            x=x,
            y=y,
            button="left",
            buttons=0 if kind == "mouseReleased" else 1,
            clickCount=1,
        )

    def letter(self, kind: str, code: str) -> None:
        self.page.call("Input.dispatchKeyEvent", type=kind, code=code, key=code[-1].lower())

    def choose(self, lane: int, value: str) -> None:
        """Choose what plays a lane."""
        list_ = f"document.querySelectorAll('#hands select')[{lane}]"
        self.page.run(f"{list_}.value = '{value}'; {list_}.dispatchEvent(new Event('change')); 0")

    def touch(self, kind: str, *points: tuple[int, float, float]) -> None:
        rows = [{"id": number, "x": x, "y": y} for number, x, y in points]
        self.page.call("Input.dispatchTouchEvent", type=kind, touchPoints=rows)
