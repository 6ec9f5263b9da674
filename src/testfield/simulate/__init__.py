"""Observations and images without a renderer, for whoever asks what must come out."""
