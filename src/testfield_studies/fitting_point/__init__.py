"""Accuracy from distances that share a vertex: a study."""
