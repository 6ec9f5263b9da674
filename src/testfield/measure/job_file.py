"""How a measurement was asked for: the photographs and the options, so that it can be asked again of other images."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from testfield.errors import TestfieldError, speaking
from testfield.store.atomic import whole
from testfield.store.sheets import read_json
from testfield.store.stamp import stamp
from testfield.store.text import write_text

JOB = "job.json"
OPTIONS = (
    "field",
    "target",
    "lens",
    "hold",
    "focal_px",
    "bayer",
    "smallest_px",
    "largest_px",
    "unclear",
    "lines",
)
"""Options that say how images are measured, by their names in `testfield measure`."""

TURNED_OFF = ("dense", "shade")
"""The same of options that turn something off: `--no-dense`."""

FLAGS = ("by_folder", "rig")
"""The same of options that have no value."""


@dataclass(frozen=True)
class Job:
    """`images` files or folders, and `options` as the command line has them, with absolute paths."""

    images: tuple[Path, ...]
    options: tuple[str, ...]
    cameras: bool = False

    def option(self, name: str) -> str | None:
        """The value of an option, by its name on the command line; None where it was not given."""
        return self.options[self.options.index(name) + 1] if name in self.options else None


def job_of(arguments: dict[str, Any]) -> Job:
    """The job that the arguments of `testfield measure`, by name, ask for."""
    options: list[str] = []
    for name in OPTIONS:
        value = arguments.get(name)
        if value not in (None, "", False):
            text = str(value.resolve()) if isinstance(value, Path) else str(value)
            options += [f"--{name.replace('_', '-')}", text]
    options += [f"--no-{name}" for name in TURNED_OFF if arguments.get(name) is False]
    options += [f"--{name.replace('_', '-')}" for name in FLAGS if arguments.get(name)]
    several = bool(arguments.get("by_folder") or arguments.get("rig"))
    return Job(tuple(path.resolve() for path in arguments.get("images") or ()), tuple(options), several)


def save_job(job: Job, folder: Path) -> None:
    """Write `job.json` into the measurement's folder."""
    data = stamp() | {"images": [str(path) for path in job.images], "options": list(job.options)}
    with whole(folder / JOB) as path:
        write_text(path, json.dumps(data | {"cameras": job.cameras}, indent=1))


@speaking("job")
def load_job(path: Path) -> Job:
    """What `save_job` wrote. Raises `TestfieldError` where it is not there or not whole."""
    if not path.is_file():
        raise TestfieldError(
            "no job.json here: nothing says which photographs these results are of",
            str(path.parent),
            "name the folder of `testfield measure`; of an older one, measure again",
        )
    data = read_json(path)
    return Job(
        tuple(Path(str(name)) for name in data["images"]),
        tuple(str(option) for option in data["options"]),
        bool(data.get("cameras", False)),
    )
