"""Observations drawn from the truth: no image is made, each centre errs by what its noise must cost at least.

Of a dot the covariance is the physical bound of METHODS section 6.1 for its whole ellipse, with the contrast and the
noise that the scene's light and sensor give. It predicts what a run will reach before anything is rendered.
"""

import numpy as np

from testfield.camera.circle import disc_image
from testfield.camera.images import SensorSheet
from testfield.detect.observations import MEASURED, Observations
from testfield.scene.exposure import sensor_of, white_radiance
from testfield.scene.schema import SceneFile
from testfield.scene.truth import Views
from testfield.scene.world import World
from testfield.seeds import normals_of_marks

OBLIQUE_DEG = 75
"""Dots seen more obliquely are not measured."""
RIM = 64
SHADE = 0.2
"""Contrast in full shadow, as a part of the typical one."""


def draw_observations(scene: SceneFile, world: World, views: Views, seed: int) -> Observations:
    """Observations of all marks in full view that are large enough for the scene's detector.

    Each errs by its own numbers, by station, board and mark: what another hides or shows changes none.
    """
    least = scene.measure.smallest_diameter_px
    clear = (views.visible == 1) & (views.obliquity_deg < OBLIQUE_DEG) & (views.diameter_px >= least)
    station, mark = np.nonzero(clear)
    image = disc_image(
        world.interior,
        world.camera_from_world[station],
        world.mark_world_mm[mark],
        world.mark_normal[mark],
        world.marks.diameter_mm[mark] / 2,
    )
    contrast_dn, level_dn, sheet = levels(scene, world)
    snr = (contrast_dn / np.sqrt(sheet.variance_dn2(level_dn)))[mark]
    cov = bound_px2(image.moments_px2, snr, np.hypot(world.psf_sigma_px, 1 / np.sqrt(12)))
    marks, names = world.marks, tuple(board.name for board in world.field.boards)
    z = normals_of_marks(
        seed, world.station_name, names, station, marks.board[mark], marks.point[mark], marks.code[mark]
    )
    error = np.einsum("nij,nj->ni", np.linalg.cholesky(cov), z)
    return Observations(
        stations=world.station_name,
        station=station,
        xy_px=views.disc_px[station, mark] + error,
        cov_px2=cov,
        moments_px2=image.moments_px2,
        code=world.marks.code[mark],
        board=world.marks.board[mark],
        point=world.marks.point[mark],
        chi2=np.ones(len(mark)),
        status=np.full(len(mark), MEASURED, object),
    )


def bound_px2(moments_px2: np.ndarray, snr: np.ndarray, edge_px: float | np.ndarray) -> np.ndarray:
    """(n, 2, 2) least covariance of ellipses' centres: `snr` (n,) contrast over noise, `edge_px` the edge's width, one
    for all or (n,)."""
    half = np.linalg.cholesky(4 * moments_px2)
    angle = 2 * np.pi * np.arange(RIM) / RIM
    tangent = np.einsum("nij,jk->nik", half, np.array([-np.sin(angle), np.cos(angle)]))
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)  # times the element of the rim
    around = np.einsum("nik,njk->nij", normal / np.linalg.norm(normal, axis=1, keepdims=True), normal)
    around *= 2 * np.pi / RIM
    return np.linalg.inv(around) * (2 * edge_px * np.sqrt(np.pi) / snr**2)[:, None, None]


def levels(scene: SceneFile, world: World) -> tuple[np.ndarray, np.ndarray, SensorSheet]:
    """(marks,) contrast of each mark and the level half way between its white and its black, in DN; what the sensor's
    noise is at a level."""
    white, contrast = white_radiance(world)
    sensor = sensor_of(scene)
    dn = sensor.electrons_per_radiance / sensor.gain_e_per_dn
    # Where no lamp shines there is still the light that the room reflects, which the estimate leaves out.
    bright = contrast > 0
    ratio = float(np.median(white[bright] / contrast[bright]))
    contrast = np.maximum(contrast, SHADE * np.median(contrast[bright]))
    white = np.maximum(white, ratio * contrast)
    level = sensor.black_level_dn + dn * (white - contrast / 2)
    return dn * contrast, level, sensor.sheet
