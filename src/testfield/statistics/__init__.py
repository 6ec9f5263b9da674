"""Decisions from figures that scatter: bands, intervals, tests. Pure mathematics, no files and no plots (METHODS 9)."""
