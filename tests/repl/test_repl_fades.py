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
    player_session = Stepped(ROUTED, tmp_path)
    player_session.ok("play")
    player_session.run(0.3)
    result = []
    for line in lines:
        player_session.ok(f"{line} now")
        position = player_session.session.schedule.running.start
        player_session.run(0.25)
        result.append((line, position))
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)
    loud = {
        line: worst(player_session.sound, position, player_session.rate)
        for line, position in result
    }
    assert max(loud.values()) < 1.5, loud


def test_a_route_with_a_delay_does_not_click_when_it_goes(tmp_path: Path) -> None:
    route = "{from: bells, to: [1], radiate: {distance: 3m, radius: 5cm}}"
    text = SCORE.replace("SOX", "SOA") + f"mix: {{channels: 4, route: [{route}]}}\n"
    player_session = Stepped(text, tmp_path)
    player_session.ok("play")
    player_session.run(0.3)
    player_session.ok("route bells 3 now")
    position = player_session.session.schedule.running.start
    player_session.run(0.25)
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)
    assert worst(player_session.sound, position, player_session.rate) < 1.5


def test_a_link_that_is_removed_lets_go_in_20_ms_and_is_gone_with_the_next_line(
    tmp_path: Path,
) -> None:
    player_session = Stepped(ROUTED, tmp_path)
    player_session.ok("play")
    player_session.run(0.1)
    player_session.ok("remove bells.ab now")
    player_session.run(0.01)
    running = player_session.session.schedule.running
    assert [one.module.name for one in running.leaving] == ["ab"]
    assert "ab" not in {
        module.name for module in running.version.piece.instruments["bells"].modules
    }
    player_session.ok("gain bells -3dB now")
    assert [one.module.name for one in player_session.session.schedule.running.leaving] == ["ab"]
    player_session.run(0.1)
    player_session.ok("seed 3 now")
    assert player_session.session.schedule.running.leaving == ()
    player_session.run(0.1)
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)


def test_a_link_that_comes_back_while_it_lets_go_goes_on_from_there(tmp_path: Path) -> None:
    player_session = Stepped(ROUTED, tmp_path)
    player_session.ok("play")
    player_session.run(0.1)
    player_session.ok("remove bells.ab now")
    player_session.run(0.012)
    player_session.ok("undo now")
    player_session.run(0.3)
    running = player_session.session.schedule.running
    assert running.leaving == ()
    (glide,) = (one for one in running.glides if one.module == "ab")
    assert 0.0 < glide.before[0] < glide.after[0]
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)


def test_what_is_removed_with_an_end_of_it_is_gone_at_once(tmp_path: Path) -> None:
    player_session = Stepped(ROUTED, tmp_path)
    player_session.ok("drum = bells")
    player_session.ok("link bells.a drum.a REF K=90N/m")
    player_session.ok("play")
    player_session.run(0.1)
    player_session.ok("remove links now")
    player_session.ok("remove drum now")
    player_session.run(0.3)
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)
