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
def test_link_route_and_level_edits_do_not_click(tmp_path: Path, lines: list[str]) -> None:
    player_session = Stepped(ROUTED, tmp_path)
    player_session.ok("play")
    player_session.run(0.3)
    result = []
    for line in lines:
        player_session.ok(f"{line} now")
        position = player_session.session.schedule.running.start_frame
        player_session.run(0.25)
        result.append((line, position))
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)
    loud = {
        line: worst(player_session.sound, position, player_session.rate)
        for line, position in result
    }
    assert max(loud.values()) < 1.5, loud


def test_route_change_with_delayed_route_does_not_click(tmp_path: Path) -> None:
    route = "{from: bells, to: [1], radiate: {distance: 3m, radius: 5cm}}"
    text = SCORE.replace("SOX", "SOA") + f"mix: {{channels: 4, route: [{route}]}}\n"
    player_session = Stepped(text, tmp_path)
    player_session.ok("play")
    player_session.run(0.3)
    player_session.ok("route bells 3 now")
    position = player_session.session.schedule.running.start_frame
    player_session.run(0.25)
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)
    assert worst(player_session.sound, position, player_session.rate) < 1.5


def test_removed_link_fades_out_in_20_ms(
    tmp_path: Path,
) -> None:
    player_session = Stepped(ROUTED, tmp_path)
    player_session.ok("play")
    player_session.run(0.1)
    player_session.ok("remove bells.ab now")
    player_session.run(0.01)
    running = player_session.session.schedule.running
    assert [one.module.name for one in running.fading_links] == ["ab"]
    assert "ab" not in {
        module.name for module in running.version.piece.instruments["bells"].modules
    }
    player_session.ok("gain bells -3dB now")
    assert [one.module.name for one in player_session.session.schedule.running.fading_links] == [
        "ab"
    ]
    player_session.run(0.1)
    player_session.ok("seed 3 now")
    assert player_session.session.schedule.running.fading_links == ()
    player_session.run(0.1)
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)


def test_undo_of_link_removal_during_its_fade(tmp_path: Path) -> None:
    player_session = Stepped(ROUTED, tmp_path)
    player_session.ok("play")
    player_session.run(0.1)
    player_session.ok("remove bells.ab now")
    player_session.run(0.012)
    player_session.ok("undo now")
    player_session.run(0.3)
    running = player_session.session.schedule.running
    assert running.fading_links == ()
    (glide,) = (one for one in running.glides if one.module == "ab")
    assert 0.0 < glide.initial_values[0] < glide.final_values[0]
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)


def test_remove_instrument_during_fade_of_its_link(tmp_path: Path) -> None:
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
