"""World to radiance: the only room that imports mitsuba and drjit."""
