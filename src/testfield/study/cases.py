"""The former place of `testfield.evaluate.case`."""

from testfield.evaluate.case import Case, changed, scene_table

__all__ = ["Case", "changed", "scene_table"]
