"""A plan costs no more than the cheapest plain setting that keeps the error too."""

import pytest
from accuracy import audit, random_scenes
from sweep import few

SPENT = 1.25
SCENES = [("law", 0), ("law", 2), ("hard", 3), ("bow", 1), ("key", 1), ("bow", 4), ("hard", 0)]


@pytest.mark.parametrize(("family", "seed"), few(SCENES, 3))
def test_no_plain_setting_is_much_cheaper(family: str, seed: int):
    text = random_scenes.text(family, seed)
    found = audit.look(f"{family}-{seed}", text, (-40.0, -60.0, -80.0))
    for plan in found.plans:
        spent = found.overspending(plan)
        assert spent is None or spent <= SPENT, (plan, spent)
        assert plan.is_met or plan.warned, plan
        assert plan.excess <= 1.5, plan


def test_by_ear_nothing_is_looked_for_below_what_is_heard():
    """The waveform is promised by no budget of ears: the way stays that of the search."""
    plans = audit.look("law-0", random_scenes.text("law", 0), (audit.BY_EAR, -80.0), plain=False)
    by_ear, asked = plans.plans
    assert by_ear.how == "stepped ×1"
    assert asked.how == "ca2p ×2"
