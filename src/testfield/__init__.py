"""A rendered test field for large-scale vision metrology: images with exact truth, the real chain, scored."""

__version__ = "0.1.0"
