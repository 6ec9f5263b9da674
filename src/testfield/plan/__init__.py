"""What a scene will measure, predicted before any image, and where the next station gains most."""
