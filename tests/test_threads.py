"""What is written does not depend on the number of threads, nor on that of cores."""

import os
import subprocess
import sys
from pathlib import Path

CODE = """
import hashlib, sys
from pathlib import Path
from testfield.adjust import side_by_side
side_by_side.THREADS, side_by_side.WORTH = int(sys.argv[2]), 0
from testfield.simulate.observations import draw_observations
from testfield.chain.run import begin
from testfield.chain.stages import run_stage
folder = Path(sys.argv[1])
run, _ = begin(Path(sys.argv[3]), folder, None, 1)
draw_observations(run.scene, run.world, run.views, 1).save(folder / "observations.parquet")
for stage in ("calibrate", "reconstruct", "score"):
    run_stage(run, stage)
for name in ("calibration.json", "points.parquet"):
    print(hashlib.sha256((folder / name).read_bytes()).hexdigest())
"""


def test_calibration_and_points_are_the_same_bytes_with_1_2_and_16_threads(tmp_path: Path) -> None:
    scene = Path(__file__).parents[1] / "scenes/quick.toml"
    said = set()
    for threads in ("1", "2", "16"):
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads}
        command = [sys.executable, "-c", CODE, str(tmp_path / threads), threads, str(scene)]
        said.add(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    assert len(said) == 1 and len(said.pop().split()) == 2
