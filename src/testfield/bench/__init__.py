"""Benchmarks: this project's parts against their peers, both sides in one run, ratios first."""
