"""The words behind `python -m MODULE` of programs that have no options."""

from __future__ import annotations

import argparse
import sys


def module_arguments(*module_names: str, further_code: str = "") -> list[str]:
    """The words behind the module that runs: one for each name, then any number of `further_code`.

    `--help` prints the module's docstring. Both it and a word that is missing or begins with a dash
    end the program before it does anything.
    """
    main_module = sys.modules["__main__"]
    assert main_module.__spec__ is not None  # the process was started by `python -m`
    parser = argparse.ArgumentParser(
        f"python -m {main_module.__spec__.name.removesuffix('.__main__')}",
        description=main_module.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for name in module_names:
        parser.add_argument(name)
    if further_code:
        parser.add_argument(further_code, nargs="*", metavar=further_code)
    values = vars(parser.parse_args())
    return [values[name] for name in module_names] + (values[further_code] if further_code else [])
