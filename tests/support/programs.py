"""Programs that tests start beside Python: the Debian package of each, and how it is installed.

`python programs.py` installs what is missing, by apt as root or with sudo. Where it cannot, it says
so and ends well: the tests that need a program are then skipped, each with the command that
brings it. No import from outside Python: `make test` runs this file before there is an environment.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable

PACKAGES = {
    "chromium": "chromium",  # draws the page of `ergon view`
    "csound": "csound",  # plays exported orchestras
    "emacs": "emacs-nox",
    "faust": "faust",  # compiles exported programs
    "g++": "g++",
    "jackd": "jackd2",
    "node": "nodejs",  # runs the client of VS Code
    "openssl": "openssl",
    "parec": "pulseaudio-utils",
    "pulseaudio": "pulseaudio",
    "vim": "vim",
}
_ALSO = {"chromium": ("chromium-browser", "google-chrome", "google-chrome-stable")}
_APT_LOCK = "/var/lib/apt"  # two runs at once on one machine wait for each other


def path_of(program: str) -> str | None:
    """The path of a program, or of another that does the same."""
    result = map(shutil.which, (program, *_ALSO.get(program, ())))
    return next((path for path in result if path is not None), None)


def missing(*programs: str) -> list[str]:
    """Those of some programs (of all in the table, if none is named) that are not installed."""
    return [program for program in programs or PACKAGES if path_of(program) is None]


def remedy(programs: Iterable[str]) -> str:
    """The command that installs programs."""
    return f"apt-get install {' '.join(sorted({PACKAGES[program] for program in programs}))}"


def install(programs: Iterable[str]) -> str:
    """Install programs from Debian's packages; returns why it cannot be done, or nothing."""
    if shutil.which("apt-get") is None:
        return "there is no apt-get here"
    root: list[str] = []
    if os.geteuid() != 0:
        if shutil.which("sudo") is None:
            return "only root or sudo may install packages"
        # Nobody can type a password where there is no terminal.
        root = ["sudo"] if sys.stdin.isatty() else ["sudo", "-n"]
    steps = f"apt-get update -qq && {remedy(programs)} --yes -qq --no-install-recommends"
    # jackd2 asks whether it may run in real time, unless nobody is there to answer.
    command = ["env", "DEBIAN_FRONTEND=noninteractive", "flock", _APT_LOCK, "sh", "-c", steps]
    done = subprocess.run([*root, *command], stdout=subprocess.DEVNULL)
    return f"apt-get ended with {done.returncode}" if done.returncode else ""


def main() -> None:
    """Install what is missing, and say what and why first."""
    if not (absent := missing()):
        return
    print(f"tests use programs that are missing here: {remedy(absent)}", flush=True)
    if why := install(absent):
        print(f"not installed ({why}); the tests that need them are skipped", flush=True)


if __name__ == "__main__":
    main()
