"""How bright the boards' white will be, estimated before anything is rendered, from light that comes straight to them.

Shadows are judged by one ray from the middle of each lamp, light from all around by few directions, and reflected light
is left out: good to some tens of percent, which is enough to tell a wrong exposure from a right one.
"""

import numpy as np

from testfield.errors import TestfieldError
from testfield.scene.schema import SceneFile
from testfield.scene.sunflower import sunflower
from testfield.scene.truth import hidden
from testfield.scene.world import LUMINOUS, RETRO, World
from testfield.sensor.expose import Sensor

LAMP_NODES, SKY_DIRECTIONS = 4, 64
FAR_MM = 1e6
FULL, WISHED, LEAST_CONTRAST = 0.95, 0.7, 20.0
"""Parts of saturation that count as full and that are advised; the least contrast in sigmas of white's noise."""


def sensor_of(scene: SceneFile) -> Sensor:
    """The scene's sensor, exposed as the scene says."""
    return Sensor(
        pixel_pitch_um=scene.camera.pixel_pitch_um,
        f_number=scene.camera.f_number,
        time_ms=scene.exposure.time_ms,
        **scene.sensor.model_dump(),
    )


def check_exposure(scene: SceneFile, world: World, source: str) -> list[str]:
    """Warnings of boards whose white would saturate or drown in noise. Raises `TestfieldError` where no light falls."""
    if not len(world.field.boards):
        return []
    white, contrast = white_radiance(world)
    if not (white[world.marks.board >= 0] > 0).any():
        raise TestfieldError(
            "no board receives any light: every lamp shines away from them, and there is none from all around",
            f"{source}, room.lights",
            "turn `normal` of the lamps to the boards, or give room.ambient_w_m2_sr",
        )
    sensor = sensor_of(scene)
    sheet, where = sensor.sheet, f"{source}, exposure.time_ms = {scene.exposure.time_ms:g}"
    dn = sensor.electrons_per_radiance / sensor.gain_e_per_dn
    room_dn = sheet.saturation_dn - sheet.black_level_dn
    warnings = []
    for b, board in enumerate(world.field.boards):
        here = world.marks.board == b
        white_dn = dn * float(white[here].max())
        fits_ms = scene.exposure.time_ms * WISHED * room_dn / (dn * float(white[world.marks.board >= 0].max()))
        level = f"about {sheet.black_level_dn + white_dn:.0f} DN, and {sheet.saturation_dn:.0f} is the most"
        if white_dn > FULL * room_dn:
            warnings.append(f"{where}: the white of board '{board.name}' saturates ({level}); try {fits_ms:.2g} ms")
            continue
        contrast_dn = dn * float(np.median(contrast[here]))
        typical_dn = sheet.black_level_dn + dn * float(np.median(white[here]))
        noise_dn = float(np.sqrt(sheet.variance_dn2(np.array(typical_dn))))
        if contrast_dn < LEAST_CONTRAST * noise_dn:
            warnings.append(
                f"{where}: board '{board.name}' is left in the dark (white is {contrast_dn:.1f} DN above black, "
                f"{contrast_dn / noise_dn:.1f} times the noise); try {fits_ms:.2g} ms, or more light"
            )
    return warnings


def white_radiance(world: World) -> tuple[np.ndarray, np.ndarray]:
    """(marks,) radiance in W/(m^2 sr) of the white at each mark of the boards, and how much brighter than black it is.

    With a flash, as the station sees it that is lit best.
    """
    panel = world.marks.panel
    ink, ground = world.panels.ink_albedo[panel], world.panels.ground_albedo[panel]
    white, black = np.maximum(ink, ground), np.minimum(ink, ground)
    flash, returned = flash_light(world)
    light = _irradiance(world) + flash
    shining = np.where(world.panels.carry(LUMINOUS)[panel], world.luminous_radiance, 0)
    bright = white * light / np.pi + returned + shining
    return bright, bright - black * light / np.pi


def flash_light(world: World) -> tuple[np.ndarray, np.ndarray]:
    """(marks,) irradiance from the camera's flash at the best lit station, and radiance that retro ink sends back."""
    light, returned = np.zeros(len(world.marks)), np.zeros(len(world.marks))
    if world.flash is None:
        return light, returned
    ink = world.panels.carry(RETRO)[world.marks.panel]
    for s, eye in enumerate(world.camera_from_world.origin_mm):
        to = eye - world.mark_world_mm
        distance = np.linalg.norm(to, axis=1)
        cosine = np.maximum((to * world.mark_normal).sum(axis=1) / distance, 0)
        beam = np.maximum(-(to @ world.camera_from_world.R[s, 2]) / distance, 0) ** world.flash.falloff
        square_on = world.flash.intensity_w_sr * beam / (distance * 1e-3) ** 2 * (cosine > 0)
        light = np.maximum(light, square_on * cosine)
        if world.retro is not None:
            entrance = np.arccos(cosine) / world.retro.half_entrance_rad
            observation = world.flash.radius_mm / distance / world.retro.half_observation_rad
            coefficient = world.retro.coefficient * 2 ** -(entrance**4 + observation**2)
            back = np.where(ink, coefficient * square_on / np.maximum(cosine, 0.1), 0)
            returned = np.maximum(returned, back)
    return light, returned


def _irradiance(world: World) -> np.ndarray:
    """(marks,) irradiance in W/m^2 that comes straight to the boards' marks from the room."""
    points, frames = world.panels.place(world.marks.panel, world.marks.xy_mm)
    normals, panel = frames[:, :, 2], world.marks.panel
    points = points + 0.02 * normals
    total = np.zeros(len(points))
    node, weight = np.polynomial.legendre.leggauss(LAMP_NODES)
    for lamp in world.lights:
        R, middle = lamp.world_from_light.R[0], lamp.world_from_light.t_mm[0]
        lit = ~hidden(middle, points, world, panel)
        for x, wx in zip(node, weight, strict=True):
            for y, wy in zip(node, weight, strict=True):
                to = middle + R[:, 0] * x * lamp.size_mm[0] / 2 + R[:, 1] * y * lamp.size_mm[1] / 2 - points
                d2 = (to**2).sum(axis=1)
                cosines = np.maximum((to * normals).sum(axis=1), 0) * np.maximum(-(to @ R[:, 2]), 0) / d2
                area_mm2 = wx * wy / 4 * lamp.size_mm[0] * lamp.size_mm[1]
                total += np.where(lit, lamp.radiance * area_mm2 * cosines / d2, 0)
    boards = [np.flatnonzero(world.marks.board == b) for b in range(len(world.field.boards))]
    for point in world.point_lights:
        to = point.position_mm - points
        d2 = (to**2).sum(axis=1)
        cosine = np.maximum((to * normals).sum(axis=1) / np.sqrt(d2), 0)
        lit = ~hidden(point.position_mm, points, world, panel)
        total += np.where(lit, point.intensity_w_sr * 1e6 * cosine / d2, 0)
    around = world.ambient_radiance if world.sky is None else float(world.sky.radiance.mean())
    if around:
        for marks in boards:
            middle = int(marks[np.argmin(np.linalg.norm(world.marks.xy_mm[marks], axis=1))])
            total[marks] += np.pi * around * _open_sky(world, points[middle], frames[middle])
    return total


def _open_sky(world: World, point_mm: np.ndarray, frame: np.ndarray) -> float:
    """Part of a surface's sky, weighted with the cosine, that nothing hides."""
    across = sunflower(SKY_DIRECTIONS)
    local = np.column_stack([across, np.sqrt(1 - (across**2).sum(axis=1))])
    far = point_mm + FAR_MM * local @ frame.T
    return float(1 - hidden(point_mm, far, world, np.full(len(far), -1)).mean())
