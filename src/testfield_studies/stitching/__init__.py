"""The flexible stitched board: a study."""
