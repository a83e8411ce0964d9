"""The size of a file for README.md, which people load before they read."""

from pathlib import Path


def report_size(path: Path, largest: int) -> None:
    """Print the size of a file. Raises ValueError if it has more than `largest` bytes."""
    size = path.stat().st_size
    if size > largest:
        raise ValueError(f"{path} has {size:,} bytes; at most {largest:,} are meant")
    print(f"{path}: {size:,} bytes")
