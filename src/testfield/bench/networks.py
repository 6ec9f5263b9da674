"""Synthetic networks of any size, for measuring the bundle alone."""

from dataclasses import replace

import numpy as np

from testfield.adjust.bundle import predict
from testfield.adjust.network import HELD, Camera, Images, Network, information_of
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation

SIGMA_PX = 0.05
CAMERA = Interior(4096, 3000, np.array([4000.0, 4003, 2040, 1505, -0.1, 0.1, 0, 3e-4, -2e-4]))
"""Brown's model with k3 held at zero, which OpenCV's and COLMAP's cameras have too."""
START_OFF = np.array([20, -15, 8, -9, 0.01, -0.01, 0, 0, 0])


def free_network(images: int, points: int, rays: int | None = None, seed: int = 1) -> tuple[Network, Network]:
    """A convergent network about a field of 4 x 3 x 2 m: at its true values, and as an adjustment finds it.

    `rays`: from how many neighbouring stations each point is seen (all of them, if not given). The second network has
    pixels with noise and starting values off by centimetres.
    """
    rng = np.random.default_rng(seed)
    xyz = rng.uniform([-2000, -1500, -1000], [2000, 1500, 1000], (points, 3))
    angle = 2 * np.pi * np.arange(images) / images
    places = np.column_stack([7000 * np.cos(angle), 7000 * np.sin(angle), 2500 * np.sin(3 * angle)])
    stations = looking(places, rng.uniform(-200, 200, (images, 3)), np.pi / 2 * (np.arange(images) % 4))
    if rays is None:
        image, point = (v.ravel() for v in np.meshgrid(np.arange(images), np.arange(points), indexing="ij"))
    else:
        first = np.sort(rng.integers(0, images, points))
        point = np.repeat(np.arange(points), rays)
        image = ((first[:, None] + np.arange(rays)) % images).ravel()
    free = np.array([name != "k3" for name in CAMERA.names])
    truth = loose_points(Camera.of(CAMERA, free), stations, xyz, image, point)
    start = replace(
        truth,
        cameras=(replace(truth.cameras[0], interior=CAMERA.with_parameters(CAMERA.parameters + START_OFF)),),
        stations=Poses(
            rotation(rng.normal(0, 0.002, (images, 3))) @ stations.R, stations.t_mm + rng.normal(0, 10, (images, 3))
        ),
        point_mm=xyz + rng.normal(0, 10, xyz.shape),
        xy_px=truth.xy_px + SIGMA_PX * rng.standard_normal((len(image), 2)),
    )
    return truth, start


def plain_labels(network: Network) -> list[str]:
    """Names of a network's unknowns, stations and boards by number."""
    boards = tuple(f"B{k}" for k in range(len(network.boards)))
    return network.labels(tuple(f"S{k}" for k in range(len(network.stations))), boards)


def loose_points(
    camera: Camera, stations: Poses, point_mm: np.ndarray, image: np.ndarray, point: np.ndarray
) -> Network:
    """Points (n, 3) on no board, of which nothing is known, with the pixels (m, 2) in which they truly stand.

    Row k is point `point[k]` in image `image[k]`; every image has a place of its own. Pixels state SIGMA_PX.
    """
    n, m = len(point_mm), len(image)
    network = Network(
        cameras=(camera,),
        stations=stations,
        images=Images.one_camera(len(stations)),
        boards=Poses.identity(0),
        ways=(),
        point_mm=point_mm,
        point_board=np.full(n, -1),
        known_mm=point_mm,
        information=np.zeros((n, 3, 3)),
        image=image,
        point=point,
        xy_px=np.zeros((m, 2)),
        cov_px2=np.tile(SIGMA_PX**2 * np.eye(2), (m, 1, 1)),
        offset_px=np.zeros((m, 2)),
    )
    return replace(network, xy_px=predict(network))


def one_board(images: int, columns: int, rows: int, seed: int = 1) -> Network:
    """An exact board seen by all images with noise, held as the datum: what `cv2.calibrateCamera` adjusts."""
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.linspace(-600, 600, columns), np.linspace(-450, 450, rows)), -1).reshape(-1, 2)
    board = np.column_stack([grid, np.zeros(len(grid))])
    angle = 2 * np.pi * np.arange(images) / images
    places = np.column_stack([1100 * np.cos(angle), 1100 * np.sin(angle), 1900 + 300 * np.cos(3 * angle)])
    stations = looking(places, rng.uniform(-60, 60, (images, 3)), np.pi / 2 * (np.arange(images) % 4))
    n = len(board)
    image, point = (v.ravel() for v in np.meshgrid(np.arange(images), np.arange(n), indexing="ij"))
    m = len(image)
    network = Network(
        cameras=(Camera.of(CAMERA),),
        stations=stations,
        images=Images.one_camera(images),
        boards=Poses.identity(1),
        ways=(HELD,),
        point_mm=board,
        point_board=np.zeros(n, int),
        known_mm=board,
        information=information_of(np.zeros((n, 3))),
        image=image,
        point=point,
        xy_px=np.zeros((m, 2)),
        cov_px2=np.tile(SIGMA_PX**2 * np.eye(2), (m, 1, 1)),
        offset_px=np.zeros((m, 2)),
    )
    return replace(network, xy_px=predict(network) + SIGMA_PX * rng.standard_normal((m, 2)))


def looking(places_mm: np.ndarray, at_mm: np.ndarray, roll: np.ndarray) -> Poses:
    """Camera-from-world poses at `places_mm` (n, 3) that look at `at_mm` (n, 3), turned by `roll` (n,) rad."""
    z = at_mm - places_mm
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x = np.cross(z, [0.0, 0, 1])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    level = np.stack([x, np.cross(z, x), z], axis=1)
    R = rotation(np.column_stack([np.zeros((len(z), 2)), roll])) @ level
    return Poses(R, -np.einsum("nij,nj->ni", R, places_mm))
