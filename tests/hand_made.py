"""A field of a few boards, bars, points and observations whose errors are known by hand, and pages as tables.

Nothing here computes an error: what is wrong with each observation, board, bar and point is written down. The datum is
board A, which lies turned and shifted in the world. Numbers are chosen so that a figure that is computed in a
neighbouring way (a mean for a rms, counts of the unexpected, another factor) comes out differently.
"""

from dataclasses import dataclass, field
from html.parser import HTMLParser

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.detect.observations import MEASURED, Observations
from testfield.reconstruct.points import Points
from testfield.scene.truth import Views
from testfield.scene.world import BAR, BOARD, CHECK, Panels, TrueMarks, World
from testfield.targets.field import Field, NominalBoard, ScaleBar
from testfield.targets.marks import Marks

QUARTER_TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
"""World-from-datum: x of board A is the world's y."""
DATUM_MM = np.array([100.0, 200, 300])
UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Datum-from-board of B: its face looks along the datum's -y."""
PLAIN = [(-30.0, -40), (30, -40), (-30, 40), (30, 40)]
"""Four dots, each 50 mm from the board's middle."""
CHECKS = {
    21: (1000, 0, 0),
    22: (-1000, 0, 0),
    23: (0, 600, 0),
    24: (0, -600, 0),
    25: (0, 0, 500),
    26: (0, 0, -500),
    27: (700, 700, 700),
}
BARS = {
    31: (0, 0, 2000),
    32: (900.001, 0, 2000),
    33: (0, 0, 3000),
    34: (0, 700.002, 3000),
    35: (0, 0, 4000),
    36: (0, 0, 4499.999),
    37: (0, 0, 6000),
    38: (0, 300, 6000),
}
LOOSE = {code: np.array(xyz, float) for code, xyz in (CHECKS | BARS).items()}
DOT_PX = 20.0
_STATIONS = Poses(np.array([np.eye(3)] * 2), np.array([[0.0, 0, 5000], [500, 0, 5000]]))
"""Camera-from-datum."""


@dataclass(frozen=True)
class HandMade:
    """The truth, and what was measured of it."""

    world: World
    views: Views
    observations: Observations
    calibration: Calibration
    points: Points


def hand_made() -> HandMade:
    """All of it."""
    world = _world()
    return HandMade(world, _views(), _observations(world), _calibration(world), _points())


def _world() -> World:
    datum = Poses(QUARTER_TURN[None], DATUM_MM[None])
    in_datum = Poses(np.array([np.eye(3), UPRIGHT, np.eye(3)]), np.array([[0, 0, 0], [1000.0, 0, 0], [0, 2000, 0]]))
    boards = Poses(
        np.array([QUARTER_TURN @ R for R in in_datum.R]), np.array([QUARTER_TURN @ t + DATUM_MM for t in in_datum.t_mm])
    )
    cards = Poses(
        np.array([QUARTER_TURN] * len(LOOSE)), np.array([QUARTER_TURN @ xyz + DATUM_MM for xyz in LOOSE.values()])
    )
    sheets, on, board, point, code = [], [], [], [], []
    for b, name in enumerate("ABC"):
        codes = [0, 0, 0, 0, 1, 2] if name == "A" else [0, 0, 0, 0]
        xy = np.array([*PLAIN, (0, 50.0), (0, -50.0)][: len(codes)])
        sheets.append(NominalBoard(name, Marks(xy, np.full(len(xy), 10.0), np.array(codes)), 0.01, 0.01))
        on.append(1.00002 * xy)  # printed 20 ppm too large
        board, point, code = board + [b] * len(xy), point + [*range(len(xy))], code + codes
    n, k = len(code), len(LOOSE)
    panels = Panels(
        name=(*"ABC", *(f"card {c}" for c in LOOSE)),
        world_from_panel=Poses.join([boards, cards]),
        size_mm=np.full((3 + k, 2), 200.0),
        ground_albedo=np.full(3 + k, 0.1),
        ink_albedo=np.full(3 + k, 0.8),
    )
    marks = TrueMarks(
        panel=np.array([*board, *range(3, 3 + k)]),
        xy_mm=np.concatenate([*on, np.zeros((k, 2))]),
        diameter_mm=np.full(n + k, 10.0),
        code=np.array([*code, *LOOSE]),
        role=np.array([BOARD] * n + [CHECK] * len(CHECKS) + [BAR] * len(BARS)),
        board=np.array([*board, *[-1] * k]),
        point=np.array([*point, *[-1] * k]),
    )
    bars = (
        ScaleBar("control bar", "control", (31, 32), 900.0, 0.006),
        ScaleBar("check one", "check", (33, 34), 700.0, 0.003),
        ScaleBar("check two", "check", (35, 36), 500.0, 0.003),
        ScaleBar("check three", "check", (37, 38), 300.0, 0.003),
    )
    sheet = Field(14, tuple(sheets), bars, dict.fromkeys(LOOSE, 10.0))
    interior = Interior(1000, 800, np.array([1000.0, 1000, 499.5, 399.5, 0, 0, 0, 0, 0]))
    return World(
        name="by hand",
        seed=1,
        field_diagonal_mm=5000.0,
        panels=panels,
        marks=marks,
        world_from_board=boards,
        station_name=("left", "right"),
        camera_from_world=_STATIONS.after(Poses.join([datum, datum]).inverse()),
        interior=interior,
        psf_sigma_px=0.6,
        lights=(),
        ambient_radiance=0.5,
        field=sheet,
    )


def _at(station: int, mark: int) -> np.ndarray:
    """Where a mark's centre is imaged; its disc's centre of area lies half a pixel further right."""
    return np.array([100.0 + 30 * mark, 200 + 300 * station])


def _views() -> Views:
    n = 14 + len(LOOSE)
    centre = np.array([[_at(s, m) for m in range(n)] for s in range(2)])
    visible, diameter, obliquity = np.zeros((2, n)), np.full((2, n), DOT_PX), np.zeros((2, n))
    visible[0, [0, 1, 2, 3, 4, 5, 6, 7]] = 1
    visible[1, [0, 4, 9, 17, 18]] = 1
    diameter[0, 6] = 7.9  # too small to be expected
    diameter[0, 7], obliquity[0, 7] = 8.0, 70  # seen obliquely, and just large enough
    visible[0, 8] = 0.5  # half hidden
    clean = np.ones(n)
    clean[[14, 15, 16]] = 0.7, 0.8, 0.9
    visible[0, [14, 15, 16]] = 0.7, 0.8, 0.5  # two dirty ones, and one that is hidden besides
    return Views(centre, centre + [0.5, 0], diameter, obliquity, visible, clean=clean)


ROWS: tuple[tuple, ...] = (
    # station, code, board, point; at the image of which mark; off it by, in 0.01 px; cov in 1e-4 px^2 (xx, xy, yy)
    (0, 0, 0, 0, 0, (-3, -4), (4, 0, 4)),
    (0, 0, 0, 1, 1, (-1, 0), (1, 0, 1)),
    (0, 1, 0, 4, 4, (0, 2), (2, 1, 2)),
    (0, 2, 0, 5, 3, (0, 0), (1, 0, 1)),  # a wrong code: number 2 at the image of dot 3
    (0, 99, -1, -1, (500, 700), (0, 0), (1, 0, 1)),  # a wrong code that is nowhere in the field
    (0, 0, 0, 2, 5, (0, 0), (1, 0, 1)),  # a dot named wrongly
    (0, 0, -1, -1, (600, 700), (0, 0), (1, 0, 1)),  # a false find
    (0, 0, -1, -1, 0, (500, 0), (1, 0, 1)),  # no name, 5 px beside a mark: not false
    (0, 0, 1, 0, 6, (1, 1), (1, 0, 1)),  # right, but too small to be expected
    (0, 0, 0, 2, 2, (0, 0), (1, 0, 1), "partly hidden or disturbed"),
    (0, 0, 1, 1, 7, (-3, 0), (9, 0, 1)),  # seen obliquely
    (0, 21, -1, -1, 14, (0, -4), (1, 0, 16)),  # dirty
    (0, 0, -1, -1, 20, (0, 0), (1, 0, 1)),  # false: nobody can see that mark from here
    (0, 0, 0, 0, 0, (1, -2), (1, 0, 1)),  # the first one once more
    (1, 2, 0, 5, 5, (0, 0), (1, 0, 1)),  # a wrong code: nobody can see it from here
    (1, 0, 0, 0, 0, (2, 1), (1, 0, 1)),
    (1, 24, -1, -1, 17, (0, 0), (1, 0, 1)),
    (1, 0, 2, 1, 9, (0, 0), (1, 0, 1), "saturated"),
    (1, 25, -1, -1, 18, (-4, 3), (25, 0, 25)),
)


def _observations(world: World) -> Observations:
    xy, cov = [], []
    for station, _, _, _, where, off, (xx, xy_, yy), *_ in ROWS:
        base = np.array(where, float) if isinstance(where, tuple) else _at(station, where) + [0.5, 0]
        xy.append(base + 0.01 * np.array(off))
        cov.append(1e-4 * np.array([[xx, xy_], [xy_, yy]], float))
    column = [np.array([row[k] for row in ROWS]) for k in range(4)]
    status = np.array([row[7] if len(row) > 7 else MEASURED for row in ROWS], object)
    moments = np.tile((DOT_PX / 4) ** 2 * np.eye(2), (len(ROWS), 1, 1))
    return Observations(
        world.station_name, column[0], np.array(xy), np.array(cov), moments, *column[1:], np.ones(len(ROWS)), status
    )


def _calibration(world: World) -> Calibration:
    axes = ("rx", "ry", "rz", "tx", "ty", "tz")
    labels = ("scale", *(f"board:B.{a}" for a in axes), "cx", "fx", "fy", *(f"board:C.{a}" for a in axes))
    u = [5e-6, 4e-3, 1e-3, 3e-3, 0.03, 0.06, 0.09, 0.1, 1.0, 1.0, 1e-3, 1e-3, 1e-3, 0.06, 0.16, 1.0]
    covariance = np.diag(np.square(u))
    covariance[8, 9] = covariance[9, 8] = 0.5  # fx and fy
    c, s = np.cos(1e-3), np.sin(1e-3)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])  # a thousandth about B's normal, the datum's y
    boards = Poses(
        np.array([np.eye(3), np.eye(3), turn @ UPRIGHT]), np.array([[0, 0, 0], [0.03, 2000.04, 0], [1000, 0.12, 0]])
    )
    joints = (
        {"station": "left", "board": "A", "marks": 5, "rms_px": 0.021, "redundancy": 0.75},
        {"station": "right", "board": "B", "marks": 4, "rms_px": 0.034, "redundancy": 0.5},
    )
    quality = (
        {"board": "C", "images": 1, "links": 2, "u_position_mm": 0.0123, "u_turn_mrad": 0.0456},
        {"board": "B", "images": 3, "links": None, "u_position_mm": 0.0789, "u_turn_mrad": 0.0321},
    )
    test = {
        "variance": 1.125,
        "low": 0.91,
        "high": 1.09,
        "freedom": 250,
        "passed": False,
        "least_redundancy": 0.125,
        "uncontrolled": 3,
        "contradict": 4,
        "contradict_at_most": 2,
        "detectable_px": 0.345,
    }
    rejected = (
        {"station": "left", "board": "A", "x_px": 12.3, "y_px": 45.6, "sigmas": 7.8, "why": "odd"},
        {"station": "right", "board": "", "x_px": 65.4, "y_px": 32.1, "sigmas": 9.8},
    )
    return Calibration(
        method="hand",
        interior=world.interior.with_parameters(np.array([1001.0, 1001, 499.8, 399.5, 0, 0, 0, 0, 0])),
        station_names=world.station_name,
        stations=_STATIONS,
        board_names=("A", "C", "B"),
        boards=boards,
        scale=1.000035,
        covariance=covariance,
        labels=labels,
        sigma0=1.05,
        freedom=250,
        reprojection_rms_px=0.123,
        used=321,
        rejected=rejected,
        residual_at_px=np.array([[100.0, 100], [900, 150], [500, 700]]),
        residual_px=np.array([[0.1, 0.0]] * 3),
        graph=(("left", "A", 6), ("right", "B", 4), ("left", "C", 2)),
        notes=("a note",),
        joints=joints,
        board_quality=quality,
        test=test,
    )


SHIFT_MM = np.array([0.010, 0.020, -0.020])
"""All check points are off by this, and outwards by 1, 2 and 3 um on the axes x, y and z."""
OUTWARDS_MM = {21: 0.001, 22: 0.001, 23: 0.002, 24: 0.002, 25: 0.003, 26: 0.003}


def _points() -> Points:
    order = (33, 21, 36, 23, 32, 22, 31, 25, 34, 24, 35, 26, 37)
    moved = {32: (0.003, 0, 0), 34: (0, 0.010, 0), 36: (0, 0, -0.014)}
    xyz = []
    for code in order:
        true = LOOSE[code]
        if code in CHECKS:
            xyz.append(true + SHIFT_MM + OUTWARDS_MM[code] * true / np.linalg.norm(true))
        else:
            xyz.append(true + np.array(moved.get(code, (0, 0, 0)), float))
    check = np.array([code in CHECKS for code in order])
    # Check points: 2 um each, and in common sqrt(5) um in x and y, sqrt(12) um in z: 3, 3 and 4 um together.
    # Ends of bars: sqrt(8) um, so 4 um for a length.
    each, common = np.diag(np.where(check, 4e-6, 8e-6)), np.outer(check, check).astype(float)
    covariance = np.kron(each, np.eye(3)) + np.kron(common, np.diag([5e-6, 5e-6, 12e-6]))
    n = len(order)
    return Points(
        method="hand",
        code=np.array(order),
        xyz_mm=np.array(xyz),
        cov_xyz_mm2=covariance,
        rays=np.full(n, 2),
        residual_rms_px=np.zeros(n),
        rejected=np.zeros(n, int),
    )


@dataclass
class Page(HTMLParser):
    """A page's tables as rows of cells, its tiles as (value, title), and the texts of its paragraphs."""

    html: str
    tables: list[list[list[str]]] = field(default_factory=list)
    tiles: list[tuple[str, str]] = field(default_factory=list)
    paragraphs: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self._text = self._value = ""
        self._in_cell = False
        self.feed(self.html)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        if tag in ("td", "th"):
            self._in_cell = True
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th", "p") or (tag in ("b", "span") and not self._in_cell):
            self._text = ""
        elif tag in ("br", "small"):
            self._text += " "

    def handle_data(self, data: str) -> None:
        self._text += data

    def handle_endtag(self, tag: str) -> None:
        text = " ".join(self._text.split())
        if tag in ("td", "th"):
            self._in_cell = False
            self.tables[-1][-1].append(text)
        elif tag == "b":
            self._value = text
        elif tag == "span" and self._value:
            self.tiles.append((self._value, text))
            self._value = ""
        elif tag == "p":
            self.paragraphs.append(text)

    def table(self, *head: str) -> list[list[str]]:
        """The rows under the heads of the one table whose first heads are these."""
        (found,) = [table for table in self.tables if table and tuple(table[0][: len(head)]) == head]
        return found[1:]


def flat(card: dict | list, stem: str = "") -> dict[str, object]:
    """Every leaf under its dotted key; empty containers are leaves."""
    pairs = card.items() if isinstance(card, dict) else enumerate(card)
    found: dict[str, object] = {}
    for key, value in pairs:
        name = f"{stem}{key}"
        found |= flat(value, f"{name}.") if isinstance(value, (dict, list, tuple)) and value else {name: value}
    return found
