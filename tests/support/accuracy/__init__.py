"""The accuracy of plans: scenes, their exact motion computed without the engine, and tables.

`equations` reads the text of a scene, `reference` solves it, `random_scenes` draws scenes,
`audit` plans and renders them and compares, `tables` sums up. `python -m accuracy` writes the
page.
"""
