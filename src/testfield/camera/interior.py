"""Interior orientation: what maps a direction in the camera frame to a pixel."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from testfield.camera import smooth_field
from testfield.camera.lens import LensModel, lens_model, lens_names
from testfield.errors import TestfieldError, nearest
from testfield.store.sheets import array

LARGEST_PX = 100_000
PINHOLE = ("fx", "fy", "cx", "cy")
"""The four parameters in px that every model begins with."""
MODE = "field:"
"""How the amount of a smooth field begins its name."""


@dataclass(frozen=True)
class Interior:
    """Interior orientation of a frame camera.

    `parameters` (n,) in the order of `names`: focal lengths and principal point in px, then the coefficients of the
    lens `model`. Pixel (0, 0) is the centre of the top-left pixel. `residual_px` (2, d, d), where given, is a smooth
    field of displacements on top of the model, which makes a true lens richer than the one being calibrated:
    coefficients of Chebyshev products over the image, x and y displacement, row index for y. `modes_px` (q, 2, d, d),
    where given, are q such fields whose amounts are the last q parameters: what a calibration found the lens model not
    to follow (`calibrate/lens_misfit.py`).
    """

    width_px: int
    height_px: int
    parameters: np.ndarray
    model: str = "brown"
    residual_px: np.ndarray | None = None
    modes_px: np.ndarray | None = None

    def __getattr__(self, name: str) -> float:
        if name in PINHOLE:
            return float(self.parameters[PINHOLE.index(name)])
        raise AttributeError(name)

    @property
    def lens(self) -> LensModel:
        """The lens model's formulas."""
        return lens_model(self.model)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order: the lens model's, then `field:0` ... of the modes."""
        return (*parameter_names(self.model), *(f"{MODE}{k}" for k in range(self.modes)))

    @property
    def modes(self) -> int:
        """How many smooth fields are among the parameters."""
        return 0 if self.modes_px is None else len(self.modes_px)

    @property
    def coefficients(self) -> np.ndarray:
        """(n,) of the lens model, without those of the pinhole and without the modes'."""
        return self.parameters[len(PINHOLE) : len(PINHOLE) + len(self.lens.coefficients)]

    @property
    def without_modes(self) -> "Interior":
        """The lens model alone."""
        kept = self.parameters[: len(self.parameters) - self.modes]
        return replace(self, parameters=kept, modes_px=None)

    def with_modes(self, modes_px: np.ndarray) -> "Interior":
        """The lens model with smooth fields (q, 2, d, d) of which there is nothing yet."""
        plain = self.without_modes
        parameters = np.concatenate([plain.parameters, np.zeros(len(modes_px))])
        return replace(plain, parameters=parameters, modes_px=modes_px)

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

    @property
    def _size_px(self) -> tuple[int, int]:
        return self.width_px, self.height_px

    @property
    def field_px(self) -> np.ndarray | None:
        """(2, d, d) all that is displaced on top of the lens model; none where nothing is."""
        if self.modes_px is None:
            return self.residual_px
        return np.tensordot(self.parameters[-self.modes :], self.modes_px, 1) if self.modes else None

    def displacement(self, uv_px: np.ndarray) -> np.ndarray:
        """(..., 2) px that the field adds at undisplaced pixels (..., 2)."""
        field = self.field_px
        return np.zeros_like(uv_px) if field is None else smooth_field.displacement(field, uv_px, self._size_px)

    def displacement_slope(self, uv_px: np.ndarray) -> np.ndarray:
        """(..., 2, 2) derivatives of the displaced pixel by the undisplaced one (..., 2)."""
        field = self.field_px
        same = np.broadcast_to(np.eye(2), (*uv_px.shape, 2))
        return same if field is None else same + smooth_field.slope(field, uv_px, self._size_px)

    def by_modes(self, uv_px: np.ndarray) -> np.ndarray:
        """(n, 2, q) derivatives of the displacement at undisplaced pixels (n, 2) by the modes' amounts."""
        if self.modes_px is None:
            return np.zeros((len(uv_px), 2, 0))
        return smooth_field.values_of(self.modes_px, uv_px, self._size_px)

    def to_json(self) -> dict:
        """A plain dictionary; `from_json` reads it back."""
        data = {"model": self.model, "width_px": self.width_px, "height_px": self.height_px}
        data |= dict(zip(self.names, self.parameters.tolist(), strict=True))
        fields = {"residual_px": self.residual_px, "modes_px": self.modes_px}
        return data | {name: field.tolist() for name, field in fields.items() if field is not None}

    @staticmethod
    def from_json(data: dict) -> "Interior":
        """Inverse of `to_json`. Raises `ValueError` or `KeyError` where the table is no camera."""
        if data["model"] not in lens_names():
            raise ValueError(f"the lens model '{data['model']}' is none of {', '.join(lens_names())}")
        size = array([data["width_px"], data["height_px"]], "interior, width_px and height_px", 2, kind=int)
        if size.min() < 1 or size.max() > LARGEST_PX:
            raise ValueError(f"interior: sizes are from 1 to {LARGEST_PX} px")
        field = array(data["residual_px"], "interior, residual_px", 2, None, None) if "residual_px" in data else None
        modes = np.array(data["modes_px"], float) if "modes_px" in data else None
        blank = Interior(int(size[0]), int(size[1]), np.zeros(0), data["model"], field, modes)
        parameters = array([data[name] for name in blank.names], "interior", len(blank.names))
        if min(parameters[:2]) <= 0 or not (modes is None or np.isfinite(modes).all()):
            raise ValueError("interior: focal lengths are above zero, and all of it is finite")
        return blank.with_parameters(parameters)


def parameter_names(model: str) -> tuple[str, ...]:
    """Names of a lens model's parameters, the four of the pinhole first."""
    return (*PINHOLE, *lens_model(model).coefficients)


def check_held(names: Iterable[str], model: str, where: str = "measure.hold") -> None:
    """Raise `TestfieldError` where coefficients that are to be held at zero are none of the lens model's."""
    own = lens_model(model).coefficients
    for name in names:
        if name not in own:
            raise TestfieldError(f"the lens model '{model}' has no coefficient '{name}'", where, nearest(name, own))
