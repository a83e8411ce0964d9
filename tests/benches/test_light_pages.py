"""Pages without a browser, by which `python -m benches pointers` measures."""

import time
from pathlib import Path

from patience import until

from benches.light_pages import AMPLITUDE, move
from tests.live.test_page_hands import playing


def test_light_page_moves_two_keys_at_once(work_folder: Path):
    with playing() as piece:
        leads = [piece.lead("remi"), piece.lead("ada")]

        def arrived() -> float:
            return sum(lead.tally["taken"] + lead.tally["refused"] for lead in leads)

        sent = move(piece.url, leads[0].now() - time.monotonic(), 0.3)
        assert sent > 0
        until(lambda: arrived() == sent, "all positions")
        assert all(lead.tally["taken"] > 0 for lead in leads)
        until(lambda: piece.highest("remi") > 0.0, "a pointer")
        assert piece.highest("remi") < 1.001 * AMPLITUDE
