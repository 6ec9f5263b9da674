"""CCTag: concentric black crowns on white, whose number is told by the radii of their edges.

Tables and layout are those of CCTag (Calvet, Gurdjos, Griwodz and Gasparini, CVPR 2016; github.com/alicevision/CCTag):
32 tags of 3 crowns and 128 of 4, numbered from 0. From the outer circle inwards rings are black and white in turn, and
the innermost disc is white.
"""

from functools import cache
from pathlib import Path

import numpy as np

CROWNS = (3, 4)
TABLES = Path(__file__).parent / "tables"


@cache
def crown_radii(crowns: int) -> np.ndarray:
    """(n, 2 x crowns) radii of all edges of the tags of so many crowns, descending, in radii of the outer circle.

    Raises `ValueError` where there are no tags of so many crowns.
    """
    if crowns not in CROWNS:
        raise ValueError(f"tags have {' or '.join(map(str, CROWNS))} crowns, not {crowns}")
    inner = np.loadtxt(TABLES / f"cctag{crowns}.crowns") / 100
    radii = np.column_stack([np.ones(len(inner)), inner])
    radii.setflags(write=False)
    return radii
