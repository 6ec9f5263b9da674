"""The ruler measured: is what the renderer and the sensor make true, and how true."""
