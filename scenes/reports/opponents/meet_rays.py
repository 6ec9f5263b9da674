"""Targets by Ceres: of each the place with the least squares of its residuals in all images, with its uncertainty.

    python meet_rays.py OBSERVATIONS.csv CALIBRATION.json POINTS.csv

Camera and exterior orientations stay as they were calibrated, pixels count alike, and the uncertainty is that of their
residuals, as Ceres' users would have it. Lenses are Brown's.
"""

import csv
import json
import sys
from typing import Any

import numpy as np
import pyceres

LEAST_RAYS = 2


class Pixel(pyceres.CostFunction):
    """The residual in px of a point (3,) in one image, and its derivative."""

    def __init__(self, camera: dict[str, Any], pose: dict[str, Any], xy_px: np.ndarray) -> None:
        super().__init__()
        self.set_num_residuals(2)
        self.set_parameter_block_sizes([3])
        self.camera, self.R, self.t = camera, np.array(pose["R"]), np.array(pose["t_mm"])
        self.xy_px = xy_px

    def Evaluate(self, parameters: Any, residuals: Any, jacobians: Any) -> bool:
        """What Ceres asks for."""
        c = self.camera
        X, Y, Z = self.R @ parameters[0] + self.t
        x, y = X / Z, Y / Z
        r = x * x + y * y
        grow = 1 + r * (c["k1"] + r * (c["k2"] + r * c["k3"]))
        slope = c["k1"] + r * (2 * c["k2"] + 3 * r * c["k3"])  # of grow by r
        u = x * grow + 2 * c["p1"] * x * y + c["p2"] * (r + 2 * x * x)
        v = y * grow + c["p1"] * (r + 2 * y * y) + 2 * c["p2"] * x * y
        residuals[0] = c["fx"] * u + c["cx"] - self.xy_px[0]
        residuals[1] = c["fy"] * v + c["cy"] - self.xy_px[1]
        if jacobians is not None and jacobians[0] is not None:
            across = 2 * x * y * slope + 2 * c["p1"] * x + 2 * c["p2"] * y
            lens = np.array(
                [
                    [grow + 2 * x * x * slope + 2 * c["p1"] * y + 6 * c["p2"] * x, across],
                    [across, grow + 2 * y * y * slope + 6 * c["p1"] * y + 2 * c["p2"] * x],
                ]
            )
            plane = np.array([[1, 0, -x], [0, 1, -y]]) / Z
            jacobians[0][:] = (np.array([[c["fx"]], [c["fy"]]]) * (lens @ plane @ self.R)).ravel()
        return True


def main(observations_file: str, calibration_file: str, csv_file: str) -> None:
    """Reconstruct every coded target that belongs to no board."""
    with open(calibration_file) as file:
        calibration = json.load(file)
    images = calibration["station_names"]
    of_image = calibration.get("image_camera") or [0] * len(images)
    cameras = [calibration["interior"], *calibration.get("more_cameras", [])]
    seen: dict[str, list[Pixel]] = {}
    with open(observations_file) as file:
        for row in csv.DictReader(file):
            if int(row["board"]) < 0 and int(row["code"]) > 0 and row["station"] in images:
                k = images.index(row["station"])
                xy = np.array([float(row["x_px"]), float(row["y_px"])])
                pixel = Pixel(cameras[of_image[k]], calibration["stations"][k], xy)
                seen.setdefault(row["code"], []).append(pixel)
    with open(csv_file, "w") as file:
        print("code,x_mm,y_mm,z_mm,u_x_mm,u_y_mm,u_z_mm", file=file)
        for code, pixels in seen.items():
            if len(pixels) >= LEAST_RAYS:
                print(code, *place(pixels), sep=",", file=file)


def place(pixels: list[Pixel]) -> list[float]:
    """x, y, z in mm and their standard uncertainties."""
    across, middle = np.zeros((3, 3)), np.zeros(3)
    for one in pixels:  # begin where the lines of sight, taken without distortion, come nearest to each other
        plane = (one.xy_px - [one.camera["cx"], one.camera["cy"]]) / [one.camera["fx"], one.camera["fy"]]
        ray = one.R.T @ [*plane, 1.0]
        ray /= np.linalg.norm(ray)
        off = np.eye(3) - np.outer(ray, ray)
        across, middle = across + off, middle - off @ one.R.T @ one.t
    point = np.linalg.solve(across, middle)
    problem, options, summary = pyceres.Problem(), pyceres.SolverOptions(), pyceres.SolverSummary()
    for one in pixels:
        problem.add_residual_block(one, None, [point])
    options.minimizer_progress_to_stdout = False
    options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 1e-14
    pyceres.solve(options, problem, summary)
    normal = np.zeros((3, 3))
    squares = 0.0
    for one in pixels:
        residual, slope = np.zeros(2), np.zeros(6)
        one.Evaluate([point], residual, [slope])
        normal += slope.reshape(2, 3).T @ slope.reshape(2, 3)
        squares += float(residual @ residual)
    variance = squares / (2 * len(pixels) - 3)
    return [*point.tolist(), *np.sqrt(variance * np.diag(np.linalg.inv(normal))).tolist()]


main(*sys.argv[1:])
