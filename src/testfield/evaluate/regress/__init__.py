"""Regressions: a suite's figures are recorded once, and every later state of the code is held against them."""
