"""Rays to points with covariance."""
