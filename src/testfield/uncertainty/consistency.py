"""The former place of `testfield.statistics.consistency`."""

from testfield.statistics.consistency import decorrelated, hit_band, nees_band, pit_uniformity

__all__ = ["decorrelated", "hit_band", "nees_band", "pit_uniformity"]
