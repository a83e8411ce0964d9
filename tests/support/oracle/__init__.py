"""A second CORDIS-ANIMA engine, written from the formulas alone, to compare the core with.

`scene` describes a network and its events once for both engines; `engine` runs it in plain
loops; `linear` and `ode` are exact solutions, against which the loops themselves are tested.
"""
