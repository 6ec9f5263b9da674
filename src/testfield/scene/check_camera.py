"""Cameras and light that cannot be, or that will not do: what of a scene one camera alone can tell."""

import numpy as np

from testfield.camera.project import directions
from testfield.errors import TestfieldError
from testfield.scene.blur import blur_circles_px, streaks_px
from testfield.scene.schema import SceneFile
from testfield.scene.truth import Views
from testfield.scene.world import World

NARROWEST_PX, NARROWEST_AIRY_PX = 0.1, 0.25
LONGEST_STREAK_PX = 200.0
BLURRED = 0.7
"""Blur circle over diameter above which a target is hardly measured."""


def possible_optics(scene: SceneFile, world: World, source: str) -> None:
    """Refuse optics and exposures that cannot be, or cannot be rendered."""
    edge = world.interior.corners_px
    rim = np.concatenate([np.linspace(a, b, 20) for a, b in zip(edge, np.roll(edge, -1, axis=0), strict=True)])
    if not np.isfinite(directions(world.interior, rim)).all():
        found = zip(world.interior.names[4:], world.interior.coefficients.tolist(), strict=False)
        worst = {name: value for name, value in found if value}
        raise TestfieldError(
            f"the distortion ({', '.join(f'{k} = {v}' for k, v in worst.items())}) folds back within the image",
            f"{source}, camera",
            "weaken it, or lengthen focal_length_mm",
        )
    blur = scene.camera.psf_sigma_px
    if 0 < blur < NARROWEST_PX:
        raise TestfieldError(
            f"value {blur} is narrower than can be resolved",
            f"{source}, camera.psf_sigma_px",
            f"give 0, or {NARROWEST_PX} or more",
        )
    if 0 < world.optics.airy_px < NARROWEST_AIRY_PX:
        raise TestfieldError(
            f"wavelength x f-number is {world.optics.airy_px:.2f} px, finer than can be resolved",
            f"{source}, camera.diffraction",
            "set it to false: the pixel's own area is far larger",
        )
    if world.motion.target.moves and scene.render.mode == "path":
        raise TestfieldError(
            "render.mode = 'path' carries no moving target",
            f"{source}, target_motion",
            "move the camera instead (camera.motion), or set render.mode = 'fast'",
        )
    focus = scene.camera.focus_mm
    if focus is not None and focus <= scene.camera.focal_length_mm:
        raise TestfieldError(
            f"value {focus} is not in front of the lens' focal plane",
            f"{source}, camera.focus_mm",
            "give the distance of what is to be sharp, in mm",
        )
    v1, v2, v3 = scene.camera.vignetting
    r2 = np.linspace(0, 1, 101) ** 2
    least = float((1 + r2 * (v1 + r2 * (v2 + r2 * v3))).min())
    if least <= 0:
        raise TestfieldError(
            f"value {list(scene.camera.vignetting)} leaves less than no light ({least:.2f}) within the image",
            f"{source}, camera.vignetting",
            "weaken it: 1 + v1 r^2 + v2 r^4 + v3 r^6 must stay positive to r = 1",
        )
    if scene.exposure.shutter == "global" and scene.exposure.row_time_us:
        raise TestfieldError(
            "all rows of a global shutter are exposed at once",
            f"{source}, exposure.row_time_us",
            'leave it out, or set shutter = "rolling"',
        )
    if scene.exposure.shutter == "rolling" and not scene.exposure.row_time_us:
        raise TestfieldError(
            "a rolling shutter whose rows take no time is a global one",
            f"{source}, exposure.row_time_us",
            "give the time a row takes to read, as 10",
        )
    stations = range(len(world.camera_from_world))
    longest = max(float(np.nan_to_num(streaks_px(world, s)).max(initial=0)) for s in stations)
    if longest > LONGEST_STREAK_PX:
        raise TestfieldError(
            f"the motion during the exposure smears targets over {longest:.0f} px",
            f"{source}, exposure.time_ms",
            "shorten it, or slow the motion down",
        )


def bendable_ink(scene: SceneFile, source: str) -> None:
    """Coats and shining ink on a bent board would show the facets of its proxy mesh, not the cylinder."""
    for k, board in enumerate(scene.boards):
        ink = board.ink or scene.paint.ink
        if board.bow_mm and ink in ("gloss", "luminous"):
            raise TestfieldError(
                f"a bent board ({board.bow_mm} mm) cannot be printed with {ink} ink",
                f"{source}, boards[{k}].bow_mm",
                "set it to 0, or choose matt or retro ink",
            )


def visible_paint(scene: SceneFile, source: str) -> None:
    """Refuse paint in which nothing can be seen, and ink that would send back more light than falls on it."""
    paint, inks = scene.paint, {scene.paint.ink, *(board.ink for board in scene.boards)}
    if paint.white <= paint.black:
        raise TestfieldError(
            f"white ({scene.paint.white}) is not brighter than black ({scene.paint.black})",
            f"{source}, paint.white",
            "raise it; for black marks on white set paint.white_on_black = false",
        )
    for ink in ("retro", "luminous"):
        if ink in inks and not paint.white_on_black:
            raise TestfieldError(
                f"ink '{ink}' with white_on_black = false: the ink would be the black",
                f"{source}, paint.ink",
                "set paint.white_on_black = true, or choose matt or gloss",
            )
    if "retro" in inks:
        returned = retro_reflectance(paint.retro.coefficient_cd_lx_m2, paint.retro.half_observation_deg)
        if paint.retro.matt + returned > 1:
            raise TestfieldError(
                f"value {paint.retro.coefficient_cd_lx_m2}: with half_observation_deg = "
                f"{paint.retro.half_observation_deg} it returns {returned:.2f} of the light, with matt = "
                f"{paint.retro.matt} more than falls on it",
                f"{source}, paint.retro.coefficient_cd_lx_m2",
                "lower one",
            )
    for what, asked in (
        ("a target that moves", scene.target_motion is not None),
        ("diffraction", scene.camera.diffraction),
    ):
        if "gloss" in inks and asked:
            raise TestfieldError(
                f"glossy ink cannot be rendered together with {what}",
                f"{source}, paint.ink",
                "choose another ink, or leave out target_motion and camera.diffraction",
            )


def retro_reflectance(coefficient: float, half_observation_deg: float) -> float:
    """Part of the light at normal entrance that the retro-reflecting lobe returns: its integral over directions."""
    return float(coefficient * np.pi * np.radians(half_observation_deg) ** 2 / np.log(2))


def focused(scene: SceneFile, world: World, views: Views, source: str) -> list[str]:
    """A word where most of what is seen is out of focus."""
    if not world.optics.aperture_mm:
        return []
    circle = np.array([blur_circles_px(world, s) for s in range(len(world.station_name))])
    seen = views.visible == 1
    blurred = float((circle[seen] > BLURRED * views.diameter_px[seen]).mean()) if seen.any() else 0.0
    if blurred < 0.5:
        return []
    return [
        f"{source}, camera.focus_mm = {scene.camera.focus_mm:g}: {100 * blurred:.0f} % of the marks seen are out of "
        f"focus; blur circles are {np.median(circle[seen]):.0f} px wide"
    ]


def lit(scene: SceneFile, source: str) -> list[str]:
    """Refuse a scene without light; a warning for ink that nothing lights as it needs."""
    room, flash = scene.room, scene.camera.flash
    inks = {scene.paint.ink, *(board.ink for board in scene.boards)}
    flashes = flash is not None and flash.on
    around = room.environment is not None or room.ambient_w_m2_sr > 0
    if not room.lights and not around and not flashes and "luminous" not in inks:
        raise TestfieldError(
            "the scene has no light",
            f"{source}, room",
            "add room.lights, ambient_w_m2_sr, an environment, or camera.flash",
        )
    if "retro" in inks and not flashes:
        return [f"{source}: retro-reflective ink is seen without camera.flash, so it is no brighter than matt ink"]
    return []
