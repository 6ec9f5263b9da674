"""Grey system theory: uncertainty of small samples, and what drives accuracy: a study."""
