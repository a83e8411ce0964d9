"""Fuzzers that stay: a table of readers, what each is given by seed, and one rule for all."""
