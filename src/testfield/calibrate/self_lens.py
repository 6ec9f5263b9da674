"""Which parameters of a lens the images of a free network determine.

What images cannot tell of the lens is named, and held to what anybody knows of a lens unseen: with that uncertainty,
not exactly, so that what is claimed of everything else is true. Which parameters those are is asked one group after
another: a group is freed when all that is free is then known better than so.
"""

from dataclasses import replace

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust, predict
from testfield.adjust.network import Camera, Layout, Network
from testfield.calibrate.self_start import SQUARE
from testfield.camera.lens import ASPECT, PRINCIPAL_POINT
from testfield.camera.project import camera_jacobian
from testfield.errors import TestfieldError

GUESSED = {"focal length": 0.2, "principal point": 0.015, "aspect": 1e-3, "lens": 0.002}
"""How well anybody knows a lens unseen: the focal length as a part of itself; the principal point as a part of the
image's width; fy / fx; a coefficient by what it moves at the outermost point, as a part of the image's width. What a
network tells less well than this it does not determine."""


def free_what_is_determined(
    network: Network, stations: tuple[str, ...], hold: tuple[str, ...], cameras: tuple[str, ...] = ()
) -> tuple[Network, list[str]]:
    """The network with more of its lenses' parameters freed as in `_freed`, one camera after another, and what is said
    of them; `cameras` are their names where there are several."""
    said: list[str] = []
    for number in range(len(network.cameras)):
        network, notes = _freed(network, number, stations, hold)
        said += [f"camera '{cameras[number]}': {note}" for note in notes] if cameras else notes
    return network, said


def _freed(
    network: Network, number: int, stations: tuple[str, ...], hold: tuple[str, ...]
) -> tuple[Network, list[str]]:
    """The network with more of a lens' parameters freed, as far as the images determine them, the others but those
    in `hold` known as well as of any lens, and what is said of these.

    Robust, and with covariances that follow the scatter, so that neither a misread code nor an unfinished lens decides.
    """
    camera = network.cameras[number]
    names = camera.interior.names
    free, square = np.isinf(camera.u), bool(np.isfinite(camera.u_aspect))
    centre = np.where(free, camera.interior.parameters, camera.known)
    limits = _of_any_lens(network, number)
    notes: list[str] = []
    for group in camera.interior.lens.parameter_groups:
        if group == ASPECT:
            wanted, with_square = free.copy(), False
            if not square or not free[:2].all():
                continue
        else:
            chosen = np.array([n in group and n not in hold for n in names])
            if not (chosen & ~free).any():
                continue
            wanted, with_square = free | chosen, square
        trial = _forgiving(_with_lens(network, number, wanted, with_square), stations)
        if trial is None:
            notes.append(f"{_said(group)} {_held(group, centre, limits, names)}: the images do not determine it")
            continue
        u = _lens_uncertainty(trial, number, wanted, with_square)
        worse = [name for name in u if u[name] > limits[name]]
        if worse:
            notes.append(_why_held(group, worse, u, _held(group, centre, limits, names), names))
            continue
        free, square, network = wanted, with_square, trial.network
        limits = _of_any_lens(network, number)
    interior = network.cameras[number].interior
    guessed = np.array([0.0 if name in hold else limits[name] for name in names])
    camera = Camera(
        interior,
        np.where(free, np.inf, guessed),
        np.where(free, interior.parameters, centre),
        limits["aspect"] if square else np.inf,
    )
    return with_camera(network, number, camera), notes


def with_camera(network: Network, number: int, camera: Camera) -> Network:
    """The network with another camera in the place of one."""
    cameras = list(network.cameras)
    cameras[number] = camera
    return replace(network, cameras=tuple(cameras))


def _with_lens(network: Network, number: int, free: np.ndarray, square: bool) -> Network:
    interior = network.cameras[number].interior
    camera = Camera(interior, np.where(free, np.inf, 0.0), interior.parameters, SQUARE if square else np.inf)
    return with_camera(network, number, camera)


def _forgiving(network: Network, stations: tuple[str, ...]) -> Adjustment | None:
    """A robust adjustment whose covariances are those of the scatter; None where it does not come to rest."""
    labels = network.labels(stations, (), (), tuple(f"point{k}" for k in range(len(network.point_mm))))
    claimed = network.cov_px2
    found = None
    for _ in range(2):
        white = np.linalg.solve(np.linalg.cholesky(claimed), (network.xy_px - predict(network))[..., None])[..., 0]
        factor = max(float(np.median(np.linalg.norm(white, axis=1)) / 1.1774) ** 2, 1.0)
        try:
            found = adjust(replace(network, cov_px2=factor * claimed), labels, robust=True)
        except (TestfieldError, np.linalg.LinAlgError):
            return None
        if not found.converged or not np.isfinite(found.network.point_mm).all():
            return None
        network = replace(found.network, cov_px2=claimed)
    return replace(found, network=network) if found else None


def _lens_uncertainty(found: Adjustment, number: int, free: np.ndarray, square: bool) -> dict[str, float]:
    """Standard uncertainties of what is free of a lens."""
    interior = found.network.cameras[number].interior
    names = interior.names
    place = int(Layout.of(found.network).camera[number]) + np.cumsum(free) - 1
    C = found.covariance
    u = {name: float(np.sqrt(max(C[place[k], place[k]], 0))) for k, name in enumerate(names) if free[k]}
    if not square and free[:2].all():
        d = np.zeros(len(C))
        d[place[:2]] = [-1 / interior.fx, 1 / interior.fx]
        u["aspect"] = float(np.sqrt(max(d @ C @ d, 0)))
    return u


def _of_any_lens(network: Network, number: int) -> dict[str, float]:
    """Standard uncertainties with which the parameters of any lens are known that nobody has seen."""
    interior, own = network.cameras[number].interior, network.camera == number
    at_camera = network.camera_from_datum()[network.image[own]].apply(network.point_mm[network.point[own]])
    _, by_interior, _ = camera_jacobian(interior, at_camera)
    reach = np.percentile(np.linalg.norm(by_interior, axis=1), 99, axis=0)
    moved = GUESSED["lens"] * interior.width_px / np.maximum(reach, 1e-12)
    limits = dict(zip(interior.names, moved.tolist(), strict=True))
    limits |= {name: GUESSED["focal length"] * interior.fx for name in interior.names[:2]}
    limits |= {name: GUESSED["principal point"] * interior.width_px for name in interior.names[2:4]}
    return limits | {"aspect": GUESSED["aspect"]}


def _said(group: tuple[str, ...]) -> str:
    if group == ("fx", "fy"):
        return "the focal length"
    if group == PRINCIPAL_POINT:
        return "the principal point (cx, cy)"
    if group == ASPECT:
        return "fy / fx"
    return ", ".join(group)


def _held(group: tuple[str, ...], centre: np.ndarray, limits: dict[str, float], names: tuple[str, ...]) -> str:
    """What is done with a group that the images do not determine."""
    if group == ASPECT:
        return f"is held to 1, +-{limits['aspect']:.2g}"
    at = "+-" + ", ".join(f"{limits[name]:.2g}" for name in dict.fromkeys(group))
    if group == ("fx", "fy"):
        return f"is held to its start, {centre[0]:.0f} +-{limits['fx']:.2g} px"
    if group == PRINCIPAL_POINT:
        return f"is held to the image's middle, +-{limits['cx']:.2g} px"
    return f"{'are' if len(group) > 1 else 'is'} held to zero, {at}"


def _why_held(group: tuple[str, ...], worse: list[str], u: dict[str, float], held: str, names: tuple[str, ...]) -> str:
    own = [name for name in worse if name in group] or worse
    told = ", ".join(f"{name} to +-{u[name]:.2g}{' px' if name in names[:4] else ''}" for name in own)
    other = "" if own[0] in group else " with it free"
    return f"{_said(group)} {held}: the images would tell {told}{other}, which is less than is known of any lens"
