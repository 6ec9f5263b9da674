"""A run's folder: stages in order, each kept as long as what it depends on is unchanged."""
