"""Radiance to frame: the sensor after EMVA 1288."""
