"""The bundle's blocks against the same equations in one dense matrix, and what they take of the memory."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from testfield.adjust import chunks
from testfield.adjust.bundle import adjust, predict
from testfield.adjust.groups import Structure
from testfield.adjust.known import distance_rows
from testfield.adjust.linear import linearise, whitening_of
from testfield.adjust.network import FREE, HELD, Distances, Images, Network, information_of
from testfield.bench.colmap_covariance import beside_colmap
from testfield.bench.networks import free_network, plain_labels
from testfield.camera.pose import Poses, rotation

IMAGES, POINTS, RAYS = 8, 60, 4
LEAST_OPEN = 1e-7
"""Eigenvalue of a normal matrix of unit diagonal below which its direction is open."""


def network_of_all_sorts(kind: str) -> Network:
    """Points in four of eight images each. `loose`: no more than that, a free network. `bars`: distances between some.
    `rig`: two cameras side by side at each of four stations, points on two boards of a common scale and on none."""
    truth, _ = free_network(IMAGES, POINTS, rays=RAYS)
    if kind == "loose":
        return truth
    ends = np.array([[0, 1], [1, 2], [10, 40]])
    length = np.linalg.norm(truth.point_mm[ends[:, 0]] - truth.point_mm[ends[:, 1]], axis=1)
    bars = replace(truth, distances=Distances(ends, length, np.full(3, 0.02)))
    if kind == "bars":
        return bars
    turn = rotation(np.array([[0, 0, 0], [0.02, -0.1, 0.03]]))
    board = np.repeat([0, 1, -1], [20, 20, 20])
    boards = Poses(rotation(np.array([[0, 0, 0], [0.3, 0.1, -0.2]])), np.array([[0.0, 0, 0], [100, -50, 30]]))
    local = boards.inverse()[np.maximum(board, 0)].apply(truth.point_mm)
    local = np.where((board >= 0)[:, None], local, truth.point_mm)
    u = np.where((board >= 0)[:, None], 0.05, np.inf) * np.ones((POINTS, 3))
    network = replace(
        bars,
        images=Images(np.arange(IMAGES) // 2, np.arange(IMAGES) % 2, np.arange(IMAGES) % 2),
        cameras=truth.cameras * 2,
        stations=truth.stations[::2],
        members=Poses(turn, np.array([[0.0, 0, 0], [300, 20, -10]])),
        boards=boards,
        ways=(HELD, FREE),
        point_mm=local,
        point_board=board,
        known_mm=local,
        information=information_of(u),
        scale=1.0001,
        u_scale=1e-4,
        image=np.tile(np.arange(IMAGES), POINTS),
        point=np.repeat(np.arange(POINTS), IMAGES),
        xy_px=np.zeros((IMAGES * POINTS, 2)),
        cov_px2=np.tile([[0.01, 0.004], [0.004, 0.02]], (IMAGES * POINTS, 1, 1)),
        offset_px=np.zeros((IMAGES * POINTS, 2)),
    )
    return replace(network, xy_px=predict(network))


def dense_rows(network: Network) -> tuple[np.ndarray, np.ndarray]:
    """(2m, P + 3n) whitened derivatives of all pixels, in the network's order, and those of all that was known and of
    the distances, beside each other in one matrix each."""
    s = Structure.of(network)
    d = linearise(network, s, whitening_of(network.cov_px2))
    size, n = s.layout.size, len(network.point_mm)
    rows = np.zeros((len(s.order), 2, size + 3 * n))
    for group in s.groups:
        for e in range(group.here.start, group.here.stop):
            point = s.point[e]
            at = s.kept_at[point] if group.kept else size + 3 * point
            rows[s.order[e]][:, group.columns] = d.by_unknown[e, :, : len(group.columns)]
            rows[s.order[e]][:, at : at + 3] = d.by_point[e]
    told = []
    for k, point in enumerate(network.point_mm):
        at = s.kept_at[k] if s.kept_at[k] >= 0 else size + 3 * k
        for axis in range(len(point)):
            row = np.zeros(size + 3 * n)
            row[at + axis] = np.sqrt(network.information[k, axis, axis])
            told.append(row)
    _, weight, distances = distance_rows(network, s.layout)
    for w, (columns, values) in zip(weight, distances, strict=True):
        row = np.zeros(size + 3 * n)
        row[columns] = w * values
        told.append(row)
    if network.scale_free:
        row = np.zeros(size + 3 * n)
        row[s.layout.scale] = 1 / network.u_scale
        told.append(row)
    return rows.reshape(-1, size + 3 * n), np.array(told)


@pytest.mark.parametrize("kind", ["loose", "bars", "rig"])
def test_derivatives_are_those_of_what_is_predicted(kind: str) -> None:
    network = network_of_all_sorts(kind)
    s = Structure.of(network)
    rows, _ = dense_rows(network)
    white, size = whitening_of(network.cov_px2), s.layout.size
    rng = np.random.default_rng(1)
    for _ in range(4):
        step = 1e-6 * rng.standard_normal(size)
        points = 1e-4 * rng.standard_normal((POINTS, 3))
        points[network.kept_points] = 0
        ahead, behind = (predict(network.moved(sign * step, sign * points)) for sign in (1, -1))
        seen = np.einsum("mij,mj->mi", white, ahead - behind).ravel() / 2
        told = rows @ np.concatenate([step, points.ravel()])
        assert np.abs(seen - told).max() < 1e-6 * np.abs(told).max()


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize("kind", ["loose", "bars", "rig"])
def test_all_covariances_are_those_of_one_dense_matrix(kind: str, alone: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether points are eliminated together or one by one; the datum by a bordered matrix (inner constraints)."""
    monkeypatch.setattr(chunks, "PAID", 0.0 if alone else np.inf)
    monkeypatch.setattr(chunks, "LEAST_POINTS", 7)
    network = network_of_all_sorts(kind)
    found = adjust(network, plain_labels(network), most_steps=0)
    assert all(chunk.dense != alone for chunk in found.equations.structure.chunks)
    rows, told = dense_rows(network)
    s, n = found.equations.structure, POINTS
    size = s.layout.size
    place = [np.arange(3) + (s.kept_at[k] if s.kept_at[k] >= 0 else size + 3 * k) for k in range(n)]
    used = np.concatenate([np.arange(size), *(p for k, p in enumerate(place) if s.kept_at[k] < 0)])
    dense = np.zeros((size + 3 * n, size + 3 * n))
    dense[np.ix_(used, used)] = _inverse((rows.T @ rows + told.T @ told)[np.ix_(used, used)], used, place, network)

    points = np.concatenate(place)
    blocks = np.array([dense[np.ix_(p, p)] for p in place])
    _assert_same(found.covariance, dense[:size, :size])
    _assert_same(found.cov.points(np.arange(n)), dense[np.ix_(points, points)])
    across = dense[points, :size]
    unit = np.sqrt(np.outer(np.diag(dense)[points], np.diag(dense)[:size])).clip(1e-300)
    assert np.abs((found.cov.across(np.arange(n)) - across) / unit).max() < 1e-7
    for ours, theirs in zip(found.cov.point_blocks(), blocks, strict=True):
        _assert_same(ours, theirs)
    predicted = rows @ dense @ rows.T
    redundancy = np.eye(2) - np.array([predicted[k : k + 2, k : k + 2] for k in range(0, len(rows), 2)])
    assert np.abs(found.redundancy - redundancy).max() < 1e-8


def _assert_same(ours: np.ndarray, theirs: np.ndarray) -> None:
    """Two covariances, each number in units of its two standard deviations."""
    u = np.sqrt(np.diag(theirs)).clip(1e-150)
    assert np.abs((ours - theirs) / np.outer(u, u)).max() < 1e-7


def _inverse(normal: np.ndarray, used: np.ndarray, place: list[np.ndarray], network: Network) -> np.ndarray:
    """The inverse of a normal matrix whose open directions are held by the loose points on the whole."""
    unit = 1 / np.sqrt(np.diag(normal))
    scaled = normal * unit[:, None] * unit
    values, vectors = np.linalg.eigh(scaled)
    open_ways = unit[:, None] * vectors[:, values < LEAST_OPEN]
    loose = np.isin(used, np.concatenate([p for k, p in enumerate(place) if network.point_board[k] < 0]))
    border = unit[:, None] * np.where(loose[:, None], open_ways, 0)
    border = border / np.abs(border).max(initial=1e-300)
    d, q = border.shape[1], len(scaled)
    bordered = np.block([[scaled, border], [border.T, np.zeros((d, d))]])
    return np.asarray(np.linalg.inv(bordered)[:q, :q] * unit[:, None] * unit)


def test_covariances_are_colmaps_own() -> None:
    pytest.importorskip("pycolmap")
    found = beside_colmap(10, 100, None, 1)
    assert found["relative_difference_of_u"] < 1e-8


MEMORY = """
import resource
from testfield.adjust.bundle import adjust
from testfield.bench.networks import free_network, plain_labels
_, warm = free_network(6, 100, 4)
adjust(warm, plain_labels(warm)).redundancy
_, start = free_network(100, 10_000, 16)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
found = adjust(start, plain_labels(start))
found.cov.point_blocks()
found.redundancy
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3)
"""


def test_a_network_of_160_000_observations_takes_200_mb() -> None:
    """100 images of 10,000 points. One dense matrix between points and all other unknowns would be 146 MB of it."""
    done = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 200
