"""What detection hands on: one row for each blob that was looked at, measured or turned down with a reason."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from testfield.detect.observation_table import MEASURED, positive_definite, read_table
from testfield.store.sheets import FORMAT
from testfield.targets.field import Field, code_at

__all__ = ["MEASURED", "READ", "Observations"]

READ = "read"
"""The place at which a detector that states no uncertainty read a point, where no model could be fitted; the covariance
is what such a detector's errors usually are."""
SURROUNDED = ("ring cannot be read", "surroundings are not a target's")
"""What is said of a dot that others stand near to, which look like parts of its ring."""
TEXTURE = ("no ellipse fits", "too small", "too little contrast", "part of a ring", "not an ellipse")
"""Reasons why a blob was turned down that are true of texture more often than of targets."""


def diameters(moments_px2: np.ndarray) -> np.ndarray:
    """(n,) px, of the circles that have the areas of dots with second moments (n, 2, 2)."""
    m = moments_px2
    return np.asarray(4 * np.maximum(m[:, 0, 0] * m[:, 1, 1] - m[:, 0, 1] ** 2, 0) ** 0.25)


@dataclass(frozen=True)
class Observations:
    """All observations of a run, as a structure of n rows.

    `stations` names; `station` (n,) index into it; `xy_px` (n, 2) centre of the dot's image, or a corner of a board
    whose sheet lists corners; `cov_px2` (n, 2, 2) its covariance, NaN where none is stated; `moments_px2` (n, 2, 2)
    second moments of the dot's area, that is a quarter of its squared half-axes, or of the circle around a corner in
    which nothing else is printed, NaN where nobody says; `code` (n,) the ring's number, 0 for a plain dot; `board`,
    `point` (n,) which mark of which board's sheet, -1 for none; `chi2` (n,) misfit of the dot's model per degree of
    freedom; `status` (n,) `measured`, or `read` or why not.
    `centre_of_disc` tells what the `xy_px` of a dot is: True, the centre of area of the dot's image; False, the
    projection of the mark's centre, as synthetic points give it. A corner is always the projection of the corner.

    `stations` are the images' names. Where several cameras took them, `cameras` names the camera of each image and
    `places` where it, or the rig that holds it, stood: images of one camera at one place share their exterior
    orientation, and so do the cameras of a rig but for their places in it. `times` are the images' numbers in time,
    for targets that move between them. All three are empty where one camera took each image from a place of its own.
    """

    stations: tuple[str, ...]
    station: np.ndarray
    xy_px: np.ndarray
    cov_px2: np.ndarray
    moments_px2: np.ndarray
    code: np.ndarray
    board: np.ndarray
    point: np.ndarray
    chi2: np.ndarray
    status: np.ndarray
    centre_of_disc: bool = True
    cameras: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    times: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.station)

    def take(self, rows: np.ndarray) -> "Observations":
        """The rows of an index or a mask."""
        return replace(self, **{name: getattr(self, name)[rows] for name in COLUMNS})

    @property
    def measured(self) -> "Observations":
        """Only the rows that were measured."""
        return self.take(self.status == MEASURED)

    @property
    def states_u(self) -> np.ndarray:
        """(n,) of which rows a covariance is stated: one that is finite and positive definite."""
        return positive_definite(self.cov_px2)

    def weighed(self, u_px: float) -> "Observations":
        """The same, the standard uncertainty `u_px` standing for those that nobody states."""
        stated = self.states_u[:, None, None]
        return self if stated.all() else replace(self, cov_px2=np.where(stated, self.cov_px2, u_px**2 * np.eye(2)))

    @property
    def diameter_px(self) -> np.ndarray:
        """(n,) diameter of the circle of the dot's area."""
        return diameters(self.moments_px2)

    def at_times(self, moving: tuple[int, ...]) -> "Observations":
        """The same, each moving target under the code that it has at the time of its image."""
        if not self.times or not moving:
            return self
        time = np.array(self.times, int)[self.station]
        return replace(self, code=np.where(np.isin(self.code, moving), code_at(self.code, time), self.code))

    def by(self, cameras: tuple[str, ...], places: tuple[str, ...], times: tuple[int, ...] = ()) -> "Observations":
        """The same, its images by these cameras at these places and times."""
        return replace(self, cameras=cameras, places=places, times=times)

    @staticmethod
    def join(parts: list["Observations"], stations: tuple[str, ...]) -> "Observations":
        """One set from one part for each station, in order."""
        columns: dict[str, Any] = {}
        for name in COLUMNS:
            values = [getattr(part, name) for part in parts]
            if name == "station":
                values = [np.full(len(part), k) for k, part in enumerate(parts)]
            columns[name] = np.concatenate(values)
        return replace(parts[0], stations=stations, **columns)

    @staticmethod
    def beside(parts: list["Observations"]) -> "Observations":
        """One set from parts that share their stations."""
        columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
        return replace(parts[0], **columns)

    def save(self, path: Path) -> None:
        """Write as Parquet, one row an observation; matrices as their columns."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        notes = {"format": str(FORMAT), "stations": "\n".join(self.stations)}
        notes |= {"centre_of_disc": str(self.centre_of_disc)}
        for name, values in (("cameras", self.cameras), ("places", self.places), ("times", self.times)):
            notes |= {name: "\n".join(map(str, values))} if values else {}
        pq.write_table(pa.table(self._table()).replace_schema_metadata(notes), path)

    def save_csv(self, path: Path) -> None:
        """Write the same columns as CSV, which has no place for what the metadata say: of several cameras each row has
        the `camera` of its image, the `place` where it or its rig stood, and the `time`."""
        import pyarrow as pa
        from pyarrow import csv

        of_images = {"camera": self.cameras, "place": self.places, "time": self.times}
        more = {name: np.array(values)[self.station] for name, values in of_images.items() if values}
        csv.write_csv(pa.table(self._table() | more), path)

    def _table(self) -> dict[str, np.ndarray]:
        cov, moments = self.cov_px2, self.moments_px2
        return {
            "station": np.array(self.stations, dtype=object)[self.station],
            "x_px": self.xy_px[:, 0],
            "y_px": self.xy_px[:, 1],
            "cov_xx_px2": cov[:, 0, 0],
            "cov_xy_px2": cov[:, 0, 1],
            "cov_yy_px2": cov[:, 1, 1],
            "moment_xx_px2": moments[:, 0, 0],
            "moment_xy_px2": moments[:, 0, 1],
            "moment_yy_px2": moments[:, 1, 1],
            "code": self.code,
            "board": self.board,
            "point": self.point,
            "chi2": self.chi2,
            "status": self.status.astype(str),
        }

    @staticmethod
    def load(path: Path, field: Field | None = None, size_px: tuple[int, int] | None = None) -> "Observations":
        """Read what `save`, or anybody else, wrote.

        The file is Parquet, or CSV where its name ends so. `field` and the image's `size_px` (width, height), where
        given, say what can be. Raises `TestfieldError` for what cannot (`detect/observation_table.py`).
        """
        column, notes = read_table(path, field, size_px)
        number = {name: k for k, name in enumerate(notes["stations"])}

        def symmetric(stem: str) -> np.ndarray:
            xx, xy, yy = (column[f"{stem}_{part}_px2"] for part in ("xx", "xy", "yy"))
            return np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)

        return Observations(
            stations=notes["stations"],
            station=np.array([number[name] for name in column["station"]], int),
            xy_px=np.column_stack([column["x_px"], column["y_px"]]),
            cov_px2=symmetric("cov"),
            moments_px2=symmetric("moment"),
            code=column["code"],
            board=column["board"],
            point=column["point"],
            chi2=column["chi2"],
            status=column["status"],
            centre_of_disc=notes["centre_of_disc"],
            cameras=notes["cameras"],
            places=notes["places"],
            times=notes["times"],
        )


COLUMNS = ("station", "xy_px", "cov_px2", "moments_px2", "code", "board", "point", "chi2", "status")
"""What there is of each row."""
