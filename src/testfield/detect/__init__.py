"""Frame to observations: find, centre, decode, identify. Works without any truth."""
