"""The results of each family in a file, because the page combines families audited at different
times.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from accuracy import tables
from accuracy.audit import Audit

FOLDER = Path(__file__).parents[2] / "data" / "audits"


@dataclass(frozen=True)
class FamilyResults:
    """Results of a family: date, commit, tallies by budget, and a row for each scene."""

    day: str
    commit: str
    tallies: tuple[tables.Tally, ...]
    rows: tuple[str, ...]


def results(day: str, commit: str, audits: Sequence[Audit]) -> FamilyResults:
    """The results of the audits of a family, in the form that is kept."""
    return FamilyResults(
        day, commit, tuple(tables.tallies(audits)), tuple(map(tables.scene, audits))
    )


def keep(family: str, results: FamilyResults, folder: Path = FOLDER) -> None:
    """Write the results of a family."""
    folder.mkdir(exist_ok=True)
    text = json.dumps(asdict(results), indent=1, ensure_ascii=False, allow_nan=False)
    (folder / f"{family}.json").write_text(text + "\n", encoding="utf-8")


def stored_results(family: str, folder: Path = FOLDER) -> FamilyResults | None:
    """The kept results of a family, if it was audited."""
    path = folder / f"{family}.json"
    if not path.exists():
        return None
    output = json.loads(path.read_text(encoding="utf-8"))
    output["tallies"] = tuple(tables.Tally(**own) for own in output["tallies"])
    return FamilyResults(**output | {"rows": tuple(output["rows"])})
