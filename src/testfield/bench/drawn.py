"""The former place of `testfield.simulate.observations`."""

from testfield.simulate.observations import draw_observations

__all__ = ["draw_observations"]
