"""The camera: projection and its inverse, poses, the image of a circle, and the images themselves, in float64."""
