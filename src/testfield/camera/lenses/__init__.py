"""Lens models, one a file."""
