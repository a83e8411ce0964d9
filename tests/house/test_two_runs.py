"""What two runs of the tests on one machine share is lent to one of them at a time."""

import contextlib
import threading

import pytest
import servers


def test_jack_name_waits_for_other_run(monkeypatch: pytest.MonkeyPatch) -> None:
    lend, refused, names = servers._lent, threading.Event(), []
    monkeypatch.setattr(servers, "_is_there", lambda name: False)  # no JACK is needed here

    def lent(held: contextlib.ExitStack, n_names: int) -> str:
        name = lend(held, n_names)
        if not name:
            refused.set()
        return name

    def ask() -> None:
        with servers.jack_name(1) as name:
            names.append(name)

    with servers.jack_name(1) as name:
        monkeypatch.setattr(servers, "_lent", lent)
        other = threading.Thread(target=ask)
        other.start()
        assert refused.wait(300.0)
        assert not names
    other.join(300.0)
    assert names == [name]
