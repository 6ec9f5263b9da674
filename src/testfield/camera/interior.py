"""Interior orientation: what maps a direction in the camera frame to a pixel, without the lens' formula."""

from dataclasses import dataclass, replace

import numpy as np

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
"""Order of the Brown model's parameters everywhere: pixels first, then OpenCV's dimensionless coefficients."""


@dataclass(frozen=True)
class Interior:
    """Interior orientation of a frame camera with Brown's distortion.

    `parameters` (9,) in the order of `PARAMETERS`: focal lengths and principal point in px, then k1 k2 k3 p1 p2 in
    OpenCV's normalised convention. Pixel (0, 0) is the centre of the top-left pixel.
    """

    width_px: int
    height_px: int
    parameters: np.ndarray

    def __getattr__(self, name: str) -> float:
        if name in PARAMETERS:
            return float(self.parameters[PARAMETERS.index(name)])
        raise AttributeError(name)

    def with_parameters(self, parameters: np.ndarray) -> "Interior":
        """The same sensor with other parameters (9,)."""
        return replace(self, parameters=np.asarray(parameters, float))

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) camera matrix K."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def corners_px(self) -> np.ndarray:
        """(4, 2) outermost points of the image area, clockwise from the top left, in px."""
        right, bottom = self.width_px - 0.5, self.height_px - 0.5
        return np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])

    def to_json(self) -> dict:
        """A plain dictionary; `from_json` reads it back."""
        values = dict(zip(PARAMETERS, self.parameters.tolist(), strict=True))
        return {"model": "brown", "width_px": self.width_px, "height_px": self.height_px, **values}

    @staticmethod
    def from_json(data: dict) -> "Interior":
        """Inverse of `to_json`."""
        return Interior(data["width_px"], data["height_px"], np.array([data[name] for name in PARAMETERS]))
