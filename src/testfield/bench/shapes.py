"""Bright and dark shapes that are no targets: polygons, stars, letters, rings and arcs, pieces of discs, highlights."""

from collections.abc import Callable

import numpy as np

from testfield.scene.world import TrueMesh

ALBEDO = 0.5
"""Of all shapes: how bright each one is, its light says."""
ROUND = 48
"""Corners that stand for a circle: its outline is off by a 500th of the radius."""
HIGHLIGHT = "highlight"
Strip = tuple[np.ndarray, np.ndarray]
"""Points (k, 2) of two lines between which a surface lies, in units of the shape's radius."""


def _fan(outline: np.ndarray) -> list[Strip]:
    closed = np.vstack([outline, outline[:1]])
    return [(closed, np.zeros_like(closed))]


def _polar(angle: np.ndarray, radius: np.ndarray | float) -> np.ndarray:
    return np.column_stack([np.cos(angle), np.sin(angle)]) * np.reshape(radius, (-1, 1))


def _polygon(corners: int) -> Callable[[np.random.Generator], list[Strip]]:
    return lambda _: _fan(_polar(2 * np.pi * np.arange(corners) / corners, 1.0))


def _crooked(random: np.random.Generator) -> list[Strip]:
    """A triangle or quadrilateral of which no two sides are alike."""
    corners = int(random.integers(3, 5))
    angle = 2 * np.pi * (np.arange(corners) + random.uniform(-0.25, 0.25, corners)) / corners
    return _fan(_polar(angle, random.uniform(0.7, 1.0, corners)))


def _star(random: np.random.Generator) -> list[Strip]:
    points = int(random.integers(4, 7))
    radius = np.tile([1.0, random.uniform(0.35, 0.6)], points)
    return _fan(_polar(np.pi * np.arange(2 * points) / points, radius))


def _half_disc(random: np.random.Generator) -> list[Strip]:
    """A disc of which a straight cut takes a fifth to a half."""
    outline = _polar(2 * np.pi * np.arange(ROUND) / ROUND, 1.0)
    outline[:, 0] = np.minimum(outline[:, 0], random.uniform(0.05, 0.55))
    return _fan(outline)


def _sector(random: np.random.Generator) -> list[Strip]:
    angle = np.linspace(0, random.uniform(0.5, 1.6) * np.pi, ROUND)
    return [(_polar(angle, 1.0), np.zeros((ROUND, 2)))]


def _ring(random: np.random.Generator) -> list[Strip]:
    """Like an O. The hole of a broader one would be a dot on a round sticker."""
    angle = np.linspace(0, 2 * np.pi, ROUND + 1)
    return [(_polar(angle, 1.0), _polar(angle, random.uniform(0.55, 0.85)))]


def _arc(random: np.random.Generator) -> list[Strip]:
    """Like a C."""
    angle = np.linspace(0, random.uniform(0.4, 1.7) * np.pi, ROUND)
    return [(_polar(angle, 1.0), _polar(angle, random.uniform(0.4, 0.75)))]


def _bars(*bars: tuple[float, float, float, float]) -> Callable[[np.random.Generator], list[Strip]]:
    """Rectangles by left, bottom, right, top: the strokes of a letter."""
    strips = [(np.array([[x0, y0], [x0, y1]]), np.array([[x1, y0], [x1, y1]])) for x0, y0, x1, y1 in bars]
    return lambda _: strips


SHAPES: tuple[tuple[str, float, Callable[[np.random.Generator], list[Strip]]], ...] = (
    ("triangle", 0, _polygon(3)),
    ("square", 0, _polygon(4)),
    ("pentagon", 4, _polygon(5)),
    ("hexagon", 6, _polygon(6)),
    ("crooked", 0, _crooked),
    ("star", 0, _star),
    ("half disc", 0, _half_disc),
    ("sector", 0, _sector),
    ("ring", 0, _ring),
    ("arc", 0, _arc),
    ("L", 0, _bars((-0.7, -1, -0.3, 1), (-0.3, -1, 0.7, -0.6))),
    ("T", 0, _bars((-0.2, -1, 0.2, 0.6), (-0.8, 0.6, 0.8, 1))),
    ("H", 0, _bars((-0.7, -1, -0.35, 1), (-0.35, -0.2, 0.35, 0.2), (0.35, -1, 0.7, 1))),
    ("cross", 0, _bars((-0.25, -1, 0.25, 1), (-1, -0.25, -0.25, 0.25), (0.25, -0.25, 1, 0.25))),
    (HIGHLIGHT, 0, _polygon(ROUND)),
)
"""Name, least radius in units of the picture's blur, and outline of each kind: no picture tells smaller pentagons and
hexagons from discs."""


class Shapes:
    """Shapes as they are collected: corners of faces, and the light at each of them; `blur_mm` is the picture's blur
    where they are."""

    def __init__(self, blur_mm: float) -> None:
        self.blur_mm = blur_mm
        self.corners: list[np.ndarray] = []
        self.light: list[np.ndarray] = []
        self.kinds: list[tuple[str, np.ndarray, float]] = []

    def add(
        self,
        at: np.ndarray,
        R: np.ndarray,
        radius_mm: float,
        kind: tuple[str, float, Callable[[np.random.Generator], list[Strip]]],
        ink: float,
        ground: float,
        random: np.random.Generator,
    ) -> None:
        """One shape of a `kind` in the frame `R` at `at`; `ink` and the `ground` around it as albedo under full light.
        Highlights rise from the ground to their middle, all others are a little uneven."""
        name, least, outline = kind
        radius_mm = max(radius_mm, least * self.blur_mm)
        spin = random.uniform(0, 2 * np.pi)
        turn = np.array([[np.cos(spin), -np.sin(spin)], [np.sin(spin), np.cos(spin)]])
        slope, peak = random.uniform(-0.2, 0.2, 2), random.uniform(0.3, 2.5)
        for a, b in outline(random):
            flat = np.concatenate([np.stack([a[:-1], a[1:], b[1:]], axis=1), np.stack([a[:-1], b[1:], b[:-1]], axis=1)])
            u, v = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
            area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
            flat = np.where((area < 0)[:, None, None], flat[:, ::-1], flat)[np.abs(area) > 1e-9]
            level = ink * (1 + flat @ slope)
            if name == HIGHLIGHT:
                level = ground + peak * np.clip(1 - np.linalg.norm(flat, axis=2), 0, 1)
            self.corners.append(at + (radius_mm * flat @ turn.T) @ R[:, :2].T)
            self.light.append(np.maximum(level, 0).ravel() / ALBEDO)
        self.kinds.append((name, at, radius_mm))

    def mesh(self) -> TrueMesh:
        """All of them as one body whose faces share no corners."""
        corners = np.concatenate(self.corners).reshape(-1, 3)
        return TrueMesh("shapes", corners, np.arange(len(corners)).reshape(-1, 3), ALBEDO, True)
