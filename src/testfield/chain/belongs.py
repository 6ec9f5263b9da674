"""Truth belongs to the images: which world a file of a run shows, and whether it is the one in scene.toml."""

from testfield.chain.run import Run
from testfield.errors import TestfieldError
from testfield.scene import codes, meshes, sky
from testfield.scene.room_parts import MapPart
from testfield.scene.schema import SceneFile
from testfield.store.digests import digest, file_digest

NOT_OF_THE_WORLD = {"name", "description", "acceptance", "measure", "render", "sensor", "exposure", "noise_seed"}
"""Parts of a scene that change nothing of what is true."""
MIXED = "more than one world"


def rendered_world(scene: SceneFile) -> str:
    """Digest of what radiance shows: everything in a scene that is true of the field and the cameras."""
    files = [meshes.mesh_path(part, scene.folder) for part in scene.meshes]
    if isinstance(around := scene.room.environment, MapPart):
        files.append(sky.map_path(around, scene.folder))
    if scene.code_table is not None:
        files.append(codes.codes_path(scene.code_table, scene.folder))
    # Defaults are left out, so that a scene stays the same when the schema learns of something new.
    parts = scene.model_dump(exclude_defaults=True, exclude=NOT_OF_THE_WORLD)
    return digest(parts, [file_digest(path) for path in files])


def exposed_world(scene: SceneFile, rendered: str) -> str:
    """Digest of what a frame shows: the world of its radiance, and the sensor that saw it."""
    return digest(rendered, scene.model_dump(exclude_defaults=True, include={"sensor", "exposure", "noise_seed"}))


def world_of(run: Run, names: list[str]) -> str:
    """The world that some files of a run show together; empty where none of them is the run's own."""
    worlds = {run.ledger.files[name].world for name in names if run.ledger.undamaged(name)} - {""}
    return MIXED if len(worlds) > 1 else "".join(worlds)


def check_truth(run: Run) -> None:
    """Raise `TestfieldError` where images or results that lie here were made of another scene than scene.toml says."""
    rendered = rendered_world(run.scene)
    exposed = exposed_world(run.scene, rendered)
    images = [
        (f"{folder}/{name}.{kind}", world)
        for folder, kind, world in (("radiance", "exr", rendered), ("frames", "png", exposed))
        for name in run.stations
    ]
    results = [(name, exposed) for name in ("observations.parquet", "calibration.json", "points.parquet")]
    for name, world in images + results:
        entry = run.ledger.files.get(name)
        if entry is not None and entry.world not in ("", world) and run.ledger.undamaged(name):
            raise TestfieldError(
                f"the scene has changed since {name} was made, so its truth is not that of the images",
                run.source,
                f"restore it, or make the images anew with "
                f"`testfield run {run.folder / 'scene.toml'} --out {run.folder}`",
            )
