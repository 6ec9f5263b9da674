"""The measuring pipeline and the recipes that say how it measures."""
