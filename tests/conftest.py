"""Tests make their plans themselves; those of plans that are kept say where."""

import os

os.environ["ERGON_CACHE"] = "off"
