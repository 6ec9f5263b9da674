"""Weighted least squares by parametric equations: a study."""
