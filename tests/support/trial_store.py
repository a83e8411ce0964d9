"""A store of the trials of plans, in memory."""

from ergon import _core


class TrialStore:
    """Records in memory; how many were found."""

    def __init__(self) -> None:
        self.records: dict[str, _core.TrialRecord] = {}
        self.n_found = 0

    def get(self, key: str) -> _core.TrialRecord | None:
        self.n_found += key in self.records
        return self.records.get(key)

    def put(self, key: str, record: _core.TrialRecord) -> None:
        self.records[key] = record
