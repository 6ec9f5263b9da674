import numpy as np
import pytest

from testfield.camera.circle import disc_image
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, nearest_rotation, rotation, rotation_vector
from testfield.camera.project import directions, project, project_camera, project_with_jacobian

LENS = np.array([3478.0, 3480.0, 1231.0, 1018.0, -0.102, 0.131, -0.02, 4.2e-4, -3.1e-4])
CAMERA = Interior(2448, 2048, LENS)


def _views(n: int = 60) -> tuple[Poses, np.ndarray]:
    rng = np.random.default_rng(3)
    return (
        Poses(rotation(rng.normal(0, 0.05, (n, 3))), rng.normal(0, 200, (n, 3))),
        rng.normal(0, 600, (n, 3)) + [0, 0, 5000],
    )


RATIONAL = np.array(
    [2600.0, 2610, 1231, 1018, -0.31, 0.08, 4e-4, -3e-4, 0.004, -0.02, 0.01, 0.002, 1e-3, -2e-4, -8e-4, 1e-4]
)
FISHEYE = np.array([1150.0, 1153, 1231, 1018, 0.02, -0.006, 0.002, -4e-4])
FIELD = np.random.default_rng(5).normal(0, 0.05, (2, 5, 5))
CAMERAS = {
    "brown": CAMERA,
    "rational": Interior(2448, 2048, RATIONAL, "rational"),
    "fisheye": Interior(2448, 2048, FISHEYE, "fisheye"),
    "brown_shear": Interior(2448, 2048, np.append(LENS, 4e-3), "brown_shear"),
    "brown with a residual field": Interior(2448, 2048, LENS, "brown", FIELD),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_projection_and_its_inverse_agree_to_1e_9_px_over_the_image(name: str) -> None:
    camera = CAMERAS[name]
    grid = np.stack(np.meshgrid(np.linspace(-0.5, 2447.5, 60), np.linspace(-0.5, 2047.5, 50)), -1).reshape(-1, 2)
    assert np.abs(project_camera(camera, 4000 * directions(camera, grid)) - grid).max() < 1e-9


BEYOND = {
    "stereographic": [0.083333, 0.008333, 0.000843, 0.0000854],
    "equidistant": [0.0, 0, 0, 0],
    "equisolid": [-1 / 24, 1 / 1920, -1 / 322560, 0],
    "flattening": [-0.03, -0.002, 0, 0],
}


@pytest.mark.parametrize("name", BEYOND)
def test_a_fisheye_is_inverted_to_its_last_valid_angle(name: str) -> None:
    camera = Interior(4000, 4000, np.array([700, 702, 1990, 2003, *BEYOND[name]]), "fisheye")
    last = camera.lens.last_angle(camera.parameters[4:])
    angle, turn = np.meshgrid(np.linspace(0, min(0.9999 * last, np.radians(175)), 200), np.linspace(0, 6, 9))
    rays = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=-1)
    uv = project_camera(camera, 700 * rays)
    back = directions(camera, uv)
    assert np.nanmax(angle) > np.radians(100)
    assert np.abs(project_camera(camera, back) - uv).max() < 1e-9
    steep = angle < 0.99 * last
    assert np.abs(back / np.linalg.norm(back, axis=-1, keepdims=True) - rays)[steep].max() < 1e-12
    if last < 3:
        edge = camera.parameters[:4] @ [[0, 0], [0, 0], [1, 0], [0, 1]] + [
            camera.fx * camera.lens.radial(last, camera.parameters[4:])[0] + 0.01,
            0,
        ]
        assert np.isnan(directions(camera, edge)).all()
        beyond = [np.sin(1.01 * last), 0, np.cos(1.01 * last)]
        assert np.isnan(project_camera(camera, np.array([beyond]))).all()


def test_derivatives_of_a_fisheye_agree_with_differences_beyond_90_degrees() -> None:
    camera = Interior(4000, 4000, np.array([700, 702, 1990, 2003, 0.02, -0.001, 0, 0]), "fisheye")
    points = np.array([[500.0, 100, -80], [-400, 300, 10], [3, 900, -400]])
    poses = Poses.identity(3)
    _, jacobian = project_with_jacobian(camera, poses, points)
    for k in range(3):
        step = 1e-3 * np.eye(3)[k]
        numeric = (project(camera, poses, points + step) - project(camera, poses, points - step)) / 2e-3
        assert np.allclose(numeric, jacobian.camera_point[:, :, k], rtol=1e-6, atol=1e-8)
    for k, value in enumerate(camera.parameters):
        step = np.eye(8)[k] * 1e-6 * max(1.0, abs(value))
        up, down = (project(camera.with_parameters(camera.parameters + s * step), poses, points) for s in (1, -1))
        assert np.allclose((up - down) / (2 * step[k]), jacobian.interior[:, :, k], rtol=1e-5, atol=1e-5)


def test_a_strong_radial_lens_is_inverted_up_to_its_fold() -> None:
    for model, coefficients in (("brown", [-0.5, 0, 0, 0, 0]), ("rational", [0] * 5 + [1.9, 0.4, 0, 0, 0, 0, 0])):
        camera = Interior(4000, 4000, np.array([1000, 1000, 2000, 2000, *coefficients]), model)
        reach = min(camera.lens.reach(camera.parameters[4:]), 40.0)
        points = np.column_stack([np.linspace(0, 0.9999 * reach, 300), np.zeros(300), np.ones(300)])
        uv = project_camera(camera, points)
        assert np.abs(project_camera(camera, directions(camera, uv)) - uv).max() < 1e-9


@pytest.mark.parametrize("name", ["rational", "fisheye"])
def test_opencv_agrees_on_the_other_models(name: str) -> None:
    import cv2

    camera = CAMERAS[name]
    points = np.random.default_rng(1).uniform(-1, 1, (200, 3)) * [1500, 1200, 300] + [0, 0, 3000]
    zero = np.zeros(3)
    if name == "rational":
        theirs, _ = cv2.projectPoints(points, zero, zero, camera.matrix, RATIONAL[4:])
    else:
        theirs, _ = cv2.fisheye.projectPoints(points[:, None], zero, zero, camera.matrix, FISHEYE[4:])
    assert np.abs(project_camera(camera, points) - theirs.reshape(-1, 2)).max() < 1e-8


@pytest.mark.parametrize("name", ["brown", "brown_shear", "rational", "fisheye"])
def test_derivatives_of_every_model_agree_with_differences(name: str) -> None:
    camera, (poses, points) = CAMERAS[name], _views()
    _, jacobian = project_with_jacobian(camera, poses, points)
    for k, value in enumerate(camera.parameters):
        h = 1e-6 * max(1.0, abs(value))
        step = np.eye(len(camera.parameters))[k] * h
        up, down = (project(camera.with_parameters(camera.parameters + s * step), poses, points) for s in (1, -1))
        assert np.allclose((up - down) / (2 * h), jacobian.interior[:, :, k], rtol=1e-5, atol=1e-5), camera.names[k]
    moved = [Poses(poses.R, poses.t_mm + s * np.array([0, 1e-3, 0])) for s in (1, -1)]
    numeric = (project(camera, moved[0], points) - project(camera, moved[1], points)) / 2e-3
    assert np.allclose(numeric, jacobian.camera_point[:, :, 1], rtol=1e-6, atol=1e-7)


def test_a_model_that_folds_is_found_out() -> None:
    assert CAMERAS["fisheye"].lens.reach(np.array([-0.3, 0, 0, 0])) == pytest.approx(np.tan(np.sqrt(1 / 0.9)))
    rational = CAMERAS["rational"].lens
    assert rational.reach(np.array([0, 0, 0, 0, 0, -0.25, 0, 0, 0, 0, 0, 0])) == pytest.approx(2.0)  # the pole
    assert np.isinf(rational.reach(np.zeros(12)))


def test_points_behind_the_camera_or_beyond_the_fold_are_flagged_not_folded_back() -> None:
    folding = CAMERA.with_parameters(np.array([1000, 1000, 500, 500, -0.5, 0, 0, 0, 0.0]))
    radius = folding.lens.reach(folding.parameters[4:])
    assert radius == pytest.approx(np.sqrt(1 / 1.5))
    points = np.array([[0, 0, -1.0], [1.01 * radius, 0, 1.0], [0.99 * radius, 0, 1.0]])
    assert np.isnan(project_camera(folding, points)).all(axis=1).tolist() == [True, True, False]
    assert np.isnan(directions(folding, np.array([[5000.0, 500.0]]))[0, 0])


def test_opencv_projects_to_the_same_pixels() -> None:
    import cv2

    poses, points = _views(1)
    rng = np.random.default_rng(1)
    cloud = rng.normal(0, 500, (50, 3)) + points
    theirs, _ = cv2.projectPoints(
        cloud, cv2.Rodrigues(poses.R[0])[0], poses.t_mm[0], CAMERA.matrix, LENS[[4, 5, 7, 8, 6]]
    )
    ours = project(CAMERA, Poses(np.repeat(poses.R, 50, 0), np.repeat(poses.t_mm, 50, 0)), cloud)
    assert np.abs(ours - theirs[:, 0]).max() < 1e-9


def test_every_derivative_agrees_with_differences() -> None:
    poses, points = _views()
    _, jacobian = project_with_jacobian(CAMERA, poses, points)

    def slope(at, h: float) -> np.ndarray:  # type: ignore[no-untyped-def]
        return (at(h) - at(-h)) / (2 * h)

    for k in range(9):
        h = 1e-6 * max(1.0, abs(LENS[k]))
        shift = np.eye(9)[k]
        numeric = slope(lambda e, s=shift: project(CAMERA.with_parameters(LENS + e * s), poses, points), h)
        assert np.allclose(numeric, jacobian.interior[:, :, k], rtol=1e-6, atol=1e-5)
    for k, axis in enumerate(np.eye(3)):
        turned = slope(lambda e, a=axis: project(CAMERA, Poses(rotation(e * a) @ poses.R, poses.t_mm), points), 1e-6)
        assert np.allclose(turned, jacobian.rotation[:, :, k], rtol=1e-6, atol=1e-3)
        moved = slope(lambda e, a=axis: project(CAMERA, Poses(poses.R, poses.t_mm + e * a), points), 1e-3)
        assert np.allclose(moved, jacobian.camera_point[:, :, k], rtol=1e-6, atol=1e-7)


def test_the_image_of_a_disc_matches_the_closed_form_of_methods_6_4() -> None:
    camera = Interior(3000, 2000, np.array([3000, 3000, 1500, 1000, 0, 0, 0, 0, 0.0]))
    disc = disc_image(
        camera, Poses.identity(1), np.array([[0.4, -0.3, 2.5]]), np.array([[0.5, 0, -np.sqrt(0.75)]]), np.array([0.03])
    )
    assert np.allclose(disc.centroid_px, [[1979.8302124, 639.98703953]], atol=1e-7)
    assert np.allclose(disc.centroid_px - [1980, 640], [[-0.1697876, -0.01296047]], atol=1e-7)


def test_the_image_of_a_disc_agrees_with_fine_polygons_through_the_distorted_lens() -> None:
    pose = Poses(rotation(np.array([[0.3, -0.5, 0.2]])), np.array([[100.0, -200.0, 1500.0]]))
    normal = rotation(np.array([[0.4, 0.2, 0.0]]))[:, :, 2]
    disc = disc_image(CAMERA, pose, np.array([[10.0, 20.0, 30.0]]), normal, np.array([40.0]))
    from testfield.camera.circle import plane_axes

    first, second = plane_axes(normal)
    angle = np.linspace(0, 2 * np.pi, 20001)[:-1, None]
    rim = np.array([10.0, 20, 30]) + 40 * (np.cos(angle) * first + np.sin(angle) * second)
    x, y = project(CAMERA, Poses(np.repeat(pose.R, 20000, 0), np.repeat(pose.t_mm, 20000, 0)), rim).T
    x0, y0 = x.mean(), y.mean()
    x, y = x - x0, y - y0
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = cross.sum() / 2
    cx, cy = (((v + np.roll(v, -1)) * cross).sum() / (6 * area) for v in (x, y))
    assert np.allclose(disc.centroid_px[0], [x0 + cx, y0 + cy], atol=1e-6)
    assert disc.area_px2[0] == pytest.approx(abs(area), rel=1e-7)


def test_rotations_survive_the_round_trip_and_repair() -> None:
    vectors = np.random.default_rng(0).normal(0, 1, (50, 3))
    R = rotation(vectors)
    assert np.allclose(rotation(rotation_vector(R)), R, atol=1e-12)
    assert np.allclose(nearest_rotation(R * 1.7), R, atol=1e-12)
    poses = Poses(R, vectors * 100)
    x = np.ones((50, 3))
    assert np.allclose(poses.inverse().apply(poses.apply(x)), x)
    assert np.allclose(poses.after(poses).apply(x), poses.apply(poses.apply(x)))
