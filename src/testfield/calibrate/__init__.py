"""Observations to a calibration: the camera, its stations and the boards."""
