"""`slurm.toml`: what a batch system is asked for, of which dask-jobqueue makes job scripts."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from testfield.cluster.extra import needed
from testfield.store.faults import faults_of
from testfield.store.text import decoded
from testfield.store.toml import parse_toml, read_toml

SEE = "see FORMATS.md, a cluster's file"
CLASSES = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
    "oar": "OARCluster",
    "moab": "MoabCluster",
}
NEEDS_ACCOUNT_AS = {"sge": "project", "lsf": "project", "oar": "project"}
"""Batch systems of which dask-jobqueue calls the account something else."""
GRACE_S = 120
"""So long before its time is over a worker takes no more work, so that the batch system ends none in the middle."""

Text = Annotated[str, Field(min_length=1, max_length=1000)]
Line = Annotated[str, Field(max_length=1000, pattern=r"^[^\r\n\x00]*$")]


class BatchFile(BaseModel):
    """What a batch system is asked for; every field as FORMATS.md has it."""

    model_config = ConfigDict(extra="forbid", strict=True)

    system: Literal["slurm", "pbs", "sge", "lsf", "oar", "moab"] = "slurm"
    jobs: Annotated[int, Field(ge=1, le=10_000)]
    processes: Annotated[int, Field(ge=1, le=1024)] = 1
    memory_gb: Annotated[float, Field(gt=0, le=100_000)]
    time: Annotated[str, Field(pattern=r"^(\d+-)?\d{1,3}:[0-5]\d:[0-5]\d$")] = "01:00:00"
    queue: Text | None = None
    account: Text | None = None
    python: Text | None = None
    before: Annotated[list[Line], Field(max_length=100)] = []
    directives: Annotated[list[Line], Field(max_length=100)] = []
    interface: Text | None = None
    scratch: Text | None = None
    store: Text | None = None
    patience_min: Annotated[float, Field(gt=0, le=100_000)] = 60.0

    @staticmethod
    def load(path: Path) -> "BatchFile":
        """What a TOML file asks for. Raises `TestfieldError`, all faults with their lines."""
        content = read_toml(path, "cluster's file")
        data = parse_toml(content, str(path))
        try:
            return BatchFile.model_validate(data)
        except ValidationError as error:
            raise faults_of(error, BatchFile, data, decoded(content), str(path), SEE) from error

    @property
    def seconds(self) -> int:
        """The time that a job has, s."""
        days, _, clock = self.time.rpartition("-")
        hours, minutes, seconds = (int(part) for part in clock.split(":"))
        return ((int(days or 0) * 24 + hours) * 60 + minutes) * 60 + seconds

    def cluster(self, **more: Any) -> Any:
        """A cluster of dask-jobqueue with a scheduler in this process and no job yet; `more` goes to it as it is."""
        account = NEEDS_ACCOUNT_AS.get(self.system, "account")
        lifetime = max(self.seconds - GRACE_S, self.seconds // 2)
        asked = {
            "cores": self.processes,
            "processes": self.processes,
            "memory": f"{self.memory_gb:g}GB",
            "walltime": self.time,
            "queue": self.queue,
            account: self.account,
            "python": self.python,
            "job_script_prologue": list(self.before),
            "job_extra_directives": list(self.directives),
            "interface": self.interface,
            "local_directory": self.scratch,
            "job_name": "testfield",
            # What is lost at the end of a job's time is given to the next one, which takes its place.
            "worker_extra_args": ["--lifetime", f"{lifetime}s", "--lifetime-stagger", f"{min(60, lifetime // 10)}s"],
        }
        made = getattr(needed("dask_jobqueue"), CLASSES[self.system])
        return made(**{name: value for name, value in asked.items() if value is not None}, **more)
