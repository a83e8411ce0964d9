"""What comes and goes fades: links that are typed and removed, routes, their levels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sessions import Stepped

from tests.repl.test_repl_swaps import SCORE, worst

ROUTED = SCORE + "mix: {channels: 4, route: [{from: bells, to: [1, 2]}]}\n"


@pytest.mark.parametrize(
    "lines",
    [
        ["remove bells.ab"],
        ["link bells.a bells.c REF K=900N/m", "remove links.ref-1"],
        ["link bells.a bells.c FRO Z=0.5Ns/m", "remove links.fro-1"],
        ["link bells.a bells.c BUT K=900N/m", "remove links.but-1", "undo", "redo"],
        ["route bells 3", "route bells 1 gain -12dB", "route bells 1 4"],
        ["route bells 2", "undo"],
        ["fade bells out over 8bar", "route bells 3", "undo"],
    ],
    ids=lambda lines: lines[0],
)
def test_nothing_clicks(tmp_path: Path, lines: list[str]) -> None:
    own = Stepped(ROUTED, tmp_path)
    own.ok("play")
    own.run(0.3)
    found = []
    for line in lines:
        own.ok(f"{line} now")
        at = own.session.schedule.running.start
        own.run(0.25)
        found.append((line, at))
    own.close()
    assert np.array_equal(own.again(), own.sound)
    loud = {line: worst(own.sound, at, own.rate) for line, at in found}
    assert max(loud.values()) < 1.5, loud


def test_a_route_with_a_delay_does_not_click_when_it_goes(tmp_path: Path) -> None:
    route = "{from: bells, to: [1], radiate: {distance: 3m, radius: 5cm}}"
    text = SCORE.replace("SOX", "SOA") + f"mix: {{channels: 4, route: [{route}]}}\n"
    own = Stepped(text, tmp_path)
    own.ok("play")
    own.run(0.3)
    own.ok("route bells 3 now")
    at = own.session.schedule.running.start
    own.run(0.25)
    own.close()
    assert np.array_equal(own.again(), own.sound)
    assert worst(own.sound, at, own.rate) < 1.5


def test_a_link_that_is_removed_lets_go_in_20_ms_and_is_gone_with_the_next_line(
    tmp_path: Path,
) -> None:
    own = Stepped(ROUTED, tmp_path)
    own.ok("play")
    own.run(0.1)
    own.ok("remove bells.ab now")
    own.run(0.01)
    running = own.session.schedule.running
    assert [one.module.name for one in running.leaving] == ["ab"]
    assert "ab" not in {
        module.name for module in running.version.piece.instruments["bells"].modules
    }
    own.ok("gain bells -3dB now")
    assert [one.module.name for one in own.session.schedule.running.leaving] == ["ab"]
    own.run(0.1)
    own.ok("seed 3 now")
    assert own.session.schedule.running.leaving == ()
    own.run(0.1)
    own.close()
    assert np.array_equal(own.again(), own.sound)


def test_a_link_that_comes_back_while_it_lets_go_goes_on_from_there(tmp_path: Path) -> None:
    own = Stepped(ROUTED, tmp_path)
    own.ok("play")
    own.run(0.1)
    own.ok("remove bells.ab now")
    own.run(0.012)
    own.ok("undo now")
    own.run(0.3)
    running = own.session.schedule.running
    assert running.leaving == ()
    (glide,) = (one for one in running.glides if one.module == "ab")
    assert 0.0 < glide.before[0] < glide.after[0]
    own.close()
    assert np.array_equal(own.again(), own.sound)


def test_what_is_removed_with_an_end_of_it_is_gone_at_once(tmp_path: Path) -> None:
    own = Stepped(ROUTED, tmp_path)
    own.ok("drum = bells")
    own.ok("link bells.a drum.a REF K=90N/m")
    own.ok("play")
    own.run(0.1)
    own.ok("remove links now")
    own.ok("remove drum now")
    own.run(0.3)
    own.close()
    assert np.array_equal(own.again(), own.sound)
