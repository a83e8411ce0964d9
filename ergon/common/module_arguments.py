"""The words behind `python -m MODULE` of programs that have no options."""

from __future__ import annotations

import argparse
import sys


def module_arguments(*argument_names: str, rest_metavar: str = "") -> list[str]:
    """The words behind the module that runs: one for each name, then any number of `rest_metavar`.

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
    for name in argument_names:
        parser.add_argument(name)
    if rest_metavar:
        parser.add_argument(rest_metavar, nargs="*", metavar=rest_metavar)
    values = vars(parser.parse_args())
    return [values[name] for name in argument_names] + (
        values[rest_metavar] if rest_metavar else []
    )
