from testfield.api import Measured as Measured
from testfield.api import Recipe as Recipe
from testfield.api import RunResult as RunResult
from testfield.api import Scene as Scene
from testfield.api import Score as Score
from testfield.api import Stations as Stations
from testfield.api import TestfieldError as TestfieldError
from testfield.api import arc as arc
from testfield.api import grid as grid
from testfield.api import load_scene as load_scene
from testfield.api import measure as measure
from testfield.api import open_run as open_run
from testfield.api import pose as pose
from testfield.api import register as register
from testfield.api import ring as ring
from testfield.api import run as run
from testfield.api import scattered as scattered
from testfield.api import score as score
from testfield.api import station as station
from testfield.version import __version__ as __version__

__all__: list[str]
