"""Kinds of modules: one file for each, or for a few that differ by a field.

To add a kind, write its file and name it in `ergon.instruments.module_kinds`.
"""
