"""Boards of CCTags in one image, and CCTags in a photograph without a board."""

import numpy as np

from testfield.camera.images import SensorSheet
from testfield.camera.plane_image import as_others_say
from testfield.detect.crown_model import SHAPE
from testfield.detect.crowns import Crown, read_crowns
from testfield.detect.observations import MEASURED, Observations
from testfield.targets.board_pattern import BoardPattern

CONTRADICTED_FROM = 5
"""So many tags say where another one of their board has to be."""


class CrownReader:
    """The CCTags of one image; those of one number of crowns are looked for once."""

    def __init__(self, image_dn: np.ndarray, pictures: list[np.ndarray], sheet: SensorSheet):
        self.image_dn, self.pictures, self.sheet = image_dn, pictures, sheet
        self._read: dict[int, list[Crown]] = {}

    def tags(self, crowns: int) -> list[Crown]:
        """All tags of so many crowns whose number occurs once."""
        if crowns not in self._read:
            found, _ = read_crowns(self.image_dn, self.pictures, self.sheet, crowns)
            numbers = [one.number for one in found]
            self._read[crowns] = [one for one in found if numbers.count(one.number) == 1]
        return self._read[crowns]

    def board(self, station: str, b: int, pattern: BoardPattern) -> tuple[Observations, list[np.ndarray]]:
        """The tags of board number `b`, and their outlines."""
        mine = [one for one in self.tags(pattern.crowns) if one.number in pattern.tags]
        if len(mine) >= CONTRADICTED_FROM:
            board_mm = pattern.points_mm[[one.number - pattern.first_tag for one in mine]]
            height, width = self.image_dn.shape
            there = as_others_say((board_mm, np.array([one.fitted.xy_px for one in mine])), (width, height))
            mine = [one for one, agrees in zip(mine, there, strict=True) if agrees]
        point = np.array([one.number - pattern.first_tag for one in mine], int)
        return observed(station, mine, np.full(len(mine), b), point), [one.outline_px for one in mine]


def observed(
    station: str, tags: list[Crown], board: np.ndarray, point: np.ndarray, codes: bool = False
) -> Observations:
    """Tags as observations of their centres; `codes` whether the rows tell their numbers."""
    n = len(tags)
    shape = np.array([one.fitted.theta[:SHAPE] for one in tags]).reshape(n, SHAPE)
    B = np.zeros((n, 2, 2))
    B[:, 0, 0], B[:, 1, 0], B[:, 1, 1] = shape[:, 0], shape[:, 1], shape[:, 2]
    return Observations(
        stations=(station,),
        station=np.zeros(n, int),
        xy_px=np.array([one.fitted.xy_px for one in tags]).reshape(n, 2),
        cov_px2=np.array([one.fitted.cov_px2 for one in tags]).reshape(n, 2, 2),
        moments_px2=B @ np.swapaxes(B, 1, 2) / 4,
        code=np.array([one.number if codes else 0 for one in tags], int),
        board=board,
        point=point,
        chi2=np.array([one.fitted.chi2 for one in tags]).reshape(n),
        status=np.full(n, MEASURED, dtype=object),
        centre_of_disc=not codes,
    )
