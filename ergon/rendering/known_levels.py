"""Measures of each instrument from earlier renders, so that it need not be mixed by itself
again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from . import stretches
from .balance import Balance

if TYPE_CHECKING:
    from ergon.exchange.stretch_store import Stretch, StretchStore


class KnownLevels:
    """Measures of instruments, by `keys`: hashes of all that each depends on up to the end of each
    stretch (n_stretches; n_instruments).
    """

    def __init__(
        self,
        store: StretchStore,
        keys: Sequence[Sequence[str]],
        state_keys: Callable[[int], Sequence[str]],
    ) -> None:
        """Read nothing yet; `state_keys` gives the keys of states after a stretch."""
        self._store, self._keys, self._state_keys = store, keys, state_keys

    def recall(self, balances: Sequence[Balance], stop: int) -> list[int]:
        """Set the known measures of balances up to frame `stop`; return the numbers of the
        balances that have none.
        """
        stretch_index = (stop - 1) // stretches.STRETCH_FRAMES
        return [
            number
            for number, balance in enumerate(balances)
            if not any(
                self._recall_measures(balance, keys[number], stop)
                for keys in self._keys[stretch_index:]
            )
        ]

    def put(self, balances: Sequence[Balance], balance_numbers: Sequence[int], stop: int) -> None:
        """Store what was measured of some balances up to frame `stop`."""
        index = (stop - 1) // stretches.STRETCH_FRAMES
        for balance_number in balance_numbers:
            measured, stretch_key = (
                balances[balance_number].measured,
                self._keys[index][balance_number],
            )
            known_level = self._store.get(stretch_key)
            if known_level is None or len(known_level.sound) < measured.size:
                self._store.put(stretch_key, measured.reshape(-1), b"")

    def put_states(
        self, balances: Sequence[Balance], balance_numbers: Sequence[int], n_stretches: int
    ) -> None:
        """Store the states of some balances after the first stretches."""
        if not balance_numbers:
            return
        keys = self._state_keys(n_stretches - 1)
        for balance_number in balance_numbers:
            if not self._store.has(keys[balance_number]):
                state = balances[balance_number].state()
                if state is not None:
                    self._store.put(
                        keys[balance_number], balances[balance_number].measured.reshape(-1), state
                    )

    def has_states(self, balance_numbers: Sequence[int], n_stretches: int) -> bool:
        """Whether the states of some balances after the first stretches are stored."""
        keys = self._state_keys(n_stretches - 1) if balance_numbers else ()
        return all(self._store.has(keys[number]) for number in balance_numbers)

    def states(self, balance_numbers: Sequence[int], n_stretches: int) -> list[Stretch] | None:
        """The measures and states of some balances after the first stretches; None if any is not
        known.
        """
        keys = self._state_keys(n_stretches - 1) if balance_numbers else ()
        stored = [self._store.get(keys[number]) for number in balance_numbers]
        known_states = [state for state in stored if state is not None]
        return known_states if len(known_states) == len(balance_numbers) else None

    def _recall_measures(self, balance: Balance, key: str, stop_frame: int) -> bool:
        known_level = self._store.get(key)
        if known_level is None or len(known_level.sound) % balance.n_measures:
            return False
        return balance.recall(known_level.sound.reshape(-1, balance.n_measures), stop_frame)
