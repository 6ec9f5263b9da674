"""Sound inputs of every kind beside a run: meshes, photographs and a field file."""

from pathlib import Path

import cv2
import numpy as np

FIELD = """
name = "cards"
[target]
kind = "ring14"
diameter_mm = 20.0
[[distances]]
codes = [1, 2]
length_mm = 500.0
u_mm = 0.01
"""


def make_sound(folder: Path) -> None:
    """Write them into a finished run's folder."""
    import trimesh

    scene = (folder / "scene.toml").read_text()
    (folder / "mesh").mkdir()
    body = trimesh.creation.icosphere(2, 40.0)
    for kind in ("stl", "obj", "ply", "glb"):
        body.export(folder / f"mesh/body.{kind}")
        part = f'\n[[meshes]]\nname = "body"\nfile = "body.{kind}"\nposition_mm = [0, 200, 100]\n'
        (folder / f"mesh/{kind}.toml").write_text(scene + part)
    (folder / "mesh/scene.toml").write_text((folder / "mesh/stl.toml").read_text())
    (folder / "photo").mkdir()
    frame = cv2.imread(str(next(iter(sorted((folder / "frames").glob("*.png"))))), cv2.IMREAD_UNCHANGED)
    picture = np.clip(frame.astype(float) / frame.max() * 255, 0, 255).astype(np.uint8)[::2, ::2]
    for kind in ("png", "jpg", "tif", "bmp"):
        cv2.imwrite(str(folder / f"photo/a.{kind}"), picture)
    (folder / "photo/a.exr").write_bytes(next(iter(sorted((folder / "radiance").glob("*.exr")))).read_bytes())
    (folder / "photo/field.toml").write_text(FIELD)
