"""Interior orientation: what maps a direction in the camera frame to a pixel."""

from dataclasses import dataclass, replace

import numpy as np

from testfield.camera.lens import MODELS, LensModel
from testfield.store.sheets import array

LARGEST_PX = 100_000
PINHOLE = ("fx", "fy", "cx", "cy")
"""The four parameters in px that every model begins with."""


@dataclass(frozen=True)
class Interior:
    """Interior orientation of a frame camera.

    `parameters` (n,) in the order of `names`: focal lengths and principal point in px, then the coefficients of the
    lens `model`. Pixel (0, 0) is the centre of the top-left pixel. `residual_px` (2, d, d), where given, is a smooth
    field of displacements on top of the model, which makes a true lens richer than the one being calibrated:
    coefficients of Chebyshev products over the image, x and y displacement, row index for y.
    """

    width_px: int
    height_px: int
    parameters: np.ndarray
    model: str = "brown"
    residual_px: np.ndarray | None = None

    def __getattr__(self, name: str) -> float:
        if name in PINHOLE:
            return float(self.parameters[PINHOLE.index(name)])
        raise AttributeError(name)

    @property
    def lens(self) -> LensModel:
        """The lens model's formulas."""
        return MODELS[self.model]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return parameter_names(self.model)

    def with_parameters(self, parameters: np.ndarray) -> "Interior":
        """The same sensor with other parameters (n,)."""
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

    def displacement(self, uv_px: np.ndarray) -> np.ndarray:
        """(..., 2) px that the residual field adds at undisplaced pixels (..., 2)."""
        if self.residual_px is None:
            return np.zeros_like(uv_px)
        at = 2 * (uv_px + 0.5) / [self.width_px, self.height_px] - 1
        inside = np.clip(at, -1.05, 1.05)  # a polynomial means nothing far outside the image
        parts = [np.polynomial.chebyshev.chebval2d(inside[..., 1], inside[..., 0], c) for c in self.residual_px]
        return np.stack(parts, axis=-1)

    def to_json(self) -> dict:
        """A plain dictionary; `from_json` reads it back."""
        data = {"model": self.model, "width_px": self.width_px, "height_px": self.height_px}
        data |= dict(zip(self.names, self.parameters.tolist(), strict=True))
        return data | ({} if self.residual_px is None else {"residual_px": self.residual_px.tolist()})

    @staticmethod
    def from_json(data: dict) -> "Interior":
        """Inverse of `to_json`. Raises `ValueError` or `KeyError` where the table is no camera."""
        if data["model"] not in MODELS:
            raise ValueError(f"the lens model '{data['model']}' is none of {', '.join(MODELS)}")
        names = parameter_names(data["model"])
        parameters = array([data[name] for name in names], "interior", len(names))
        size = array([data["width_px"], data["height_px"]], "interior, width_px and height_px", 2, kind=int)
        if size.min() < 1 or size.max() > LARGEST_PX or min(parameters[:2]) <= 0:
            raise ValueError("interior: sizes and focal lengths are above zero")
        field = array(data["residual_px"], "interior, residual_px", 2, None, None) if "residual_px" in data else None
        return Interior(int(size[0]), int(size[1]), parameters, data["model"], field)


def parameter_names(model: str) -> tuple[str, ...]:
    """Names of a lens model's parameters, the four of the pinhole first."""
    return (*PINHOLE, *MODELS[model].coefficients)
