"""A second CORDIS-ANIMA engine, written from the formulas alone, to compare the core with.

`scene` says what is and what will happen, once for both engines; `engine` runs it in plain
loops; `linear` and `ode` are the truths that the loops themselves are measured against.
"""
