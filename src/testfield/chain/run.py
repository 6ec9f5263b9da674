"""A run: its folder, its scene, its truth, and what the stages need to know of it."""

import platform
import shutil
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from inspect import signature
from pathlib import Path

import tomli_w

from testfield.camera.interior import check_held
from testfield.chain.recipe import recipe_of
from testfield.chain.truth import Truth
from testfield.errors import TestfieldError, gather, nearest
from testfield.registry import ALGORITHMS, find, names
from testfield.scene import codes, meshes, sky
from testfield.scene.changes import Change, folder_name, with_changes
from testfield.scene.document import Document, load_document
from testfield.scene.load import load_scene, numbered, scene_from
from testfield.scene.room_parts import MapPart
from testfield.scene.schema import SceneFile
from testfield.scene.shipped import find_scene
from testfield.scene.truth import Views
from testfield.scene.world import World
from testfield.score.scorecard import load_scorecard
from testfield.store.atomic import part_path, sweep
from testfield.store.code import PACKAGES, code_digest, package_version
from testfield.store.digests import digest, file_digest
from testfield.store.ledger import Ledger, inside
from testfield.store.stamp import now
from testfield.store.work import Pool
from testfield.targets.field import Field
from testfield.version import __version__


@dataclass
class Run:
    """One scene in one folder. `jobs` processes may work at once, those of `pool` if there is one; `source` is what
    messages call the scene, `changes` what was set in it for this run."""

    folder: Path
    scene: SceneFile
    source: str
    ledger: Ledger
    jobs: int = 1
    pool: Pool | None = None
    changes: tuple[Change, ...] = ()

    @cached_property
    def truth(self) -> Truth:
        """The truth, camera by camera and of all together."""
        return Truth.of(self.scene, self.source)

    @property
    def world(self) -> World:
        """The world with its truth."""
        return self.truth.world

    @property
    def views(self) -> Views:
        """What each station truly sees."""
        return self.truth.views

    @cached_property
    def field(self) -> Field:
        """The field's sheet, from the run's folder: what the measuring side is told."""
        return Field.load(self.need("field.json", "run"))

    @property
    def stations(self) -> tuple[str, ...]:
        """Names of the stations."""
        return self.world.station_name

    def measuring_notes(self) -> list[str]:
        """What the calibration left out or doubts, from the scorecard."""
        card = load_scorecard(self.need("scorecard.json", "score"))
        return [f"{self.scene.name}: {note}" for note in card["calibration"]["notes"]]

    def need(self, name: str, maker: str) -> Path:
        """The path of a file that must be there; `maker` is the command that makes it."""
        path = self.folder / name
        inside(self.folder, path)
        if not path.is_file():
            raise TestfieldError("this file is missing", str(path), _advice(maker, self.folder))
        return path


def begin(
    scene_path: Path, out: Path | None, seed: int | None, jobs: int, noise_seed: int | None = None
) -> tuple[Run, list[str]]:
    """Check a scene and lay out its run's folder. Returns the run and the scene's warnings.

    Nothing that an earlier run made is touched before the scene has passed every check.
    """
    run, content, warnings = checked(scene_path, out, seed, jobs, noise_seed)
    lay_out(run, content, warnings)
    return run, warnings


def checked(
    scene_path: Path | Document,
    out: Path | None,
    seed: int | None,
    jobs: int,
    noise_seed: int | None = None,
    changes: tuple[Change, ...] = (),
) -> tuple[Run, bytes, list[str]]:
    """A run whose scene has passed every check, the bytes of a scene file that needs no other, and the warnings.

    The scene is at the path, comes along under that name, or is a document. Another `seed` is another world, and
    another `noise_seed` other noise in the same one; each has a folder of its own, and so have `changes` of the scene.
    """
    given = scene_path if isinstance(scene_path, Document) else load_document(find_scene(scene_path))
    document = with_changes(given, changes)
    scene = scene_from(document)
    others = {"seed": seed, "noise_seed": noise_seed}
    seeds = {key: value for key, value in others.items() if value is not None and value != getattr(scene, key)}
    if seeds:
        document = document.with_values(
            {(key,): value for key, value in seeds.items()},
            {(key,): f"--{key.replace('_', '-')} {value}" for key, value in seeds.items()},
        )
        scene = scene_from(document)
    folder = folder_of(scene.name + folder_name(changes), out, seeds.get("seed"), seeds.get("noise_seed"))
    run = Run(folder, scene, document.source, Ledger(folder), jobs, changes=changes)
    return run, document.content, examined(run, document)


def folder_of(name: str, out: Path | None, seed: int | None, noise_seed: int | None) -> Path:
    """A run's folder: `out` or renders/NAME, with -seedN for another world and -noiseN for other noise.

    A folder that was named is taken for any world, but other noise is never put beside it into the same one.
    """
    folder = out or Path("renders") / (name if seed is None else f"{name}-seed{seed}")
    return folder if noise_seed is None else folder.with_name(f"{folder.name}-noise{noise_seed}")


def examined(run: Run, document: Document) -> list[str]:
    """The warnings of a run's scene. Raises `TestfieldError` for all that is wrong with it, each fault with its line
    in the document that the scene was read from."""
    warnings: list[str] = []
    with numbered(document):
        gather(
            lambda: check_algorithms(run.scene, run.source),
            lambda: warnings.extend(run.truth.check(run.source)),
        )
    return warnings


def lay_out(run: Run, content: bytes, warnings: list[str]) -> None:
    """Make a run's folder, with its scene file of this content, the files it names, and the field sheet.

    Raises `TestfieldError` where the folder holds another scene that somebody has changed there.
    """
    folder, scene = run.folder, run.scene
    folder.mkdir(parents=True, exist_ok=True)
    sweep(folder)
    run.ledger = Ledger(folder)  # another process may have written since the scene was read
    run.ledger.make("scene.toml", digest(content), lambda path: _write(path, content))
    named = [(meshes.mesh_path(part, scene.folder), meshes.copy_name(part)) for part in scene.meshes]
    if isinstance(around := scene.room.environment, MapPart):
        named.append((sky.map_path(around, scene.folder), sky.copy_name(around)))
    if scene.code_table is not None:
        named.append((codes.codes_path(scene.code_table, scene.folder), codes.copy_name(scene.code_table)))
    for source, name in named:  # so that the folder needs nothing outside it
        if source.resolve() != (folder / name).resolve():
            run.ledger.make(name, file_digest(source), partial(shutil.copyfile, source))
    field = run.truth.told
    run.ledger.make("field.json", field_key(field), field.save, world=digest(field))
    run.ledger.note(
        scene=scene.name,
        seed=scene.seed,
        noise_seed=scene.noise_seed,
        changes=[change.text for change in run.changes],
        begun=now(),
        command=" ".join(["testfield", *sys.argv[1:]]),
        versions={"testfield": __version__, "python": platform.python_version()}
        | {name: package_version(name) for name in PACKAGES},
        machine=f"{platform.system()} {platform.machine()}, {platform.processor() or 'processor not named'}",
        warnings=warnings,
    )


def _write(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def check_algorithms(scene: SceneFile, source: str) -> None:
    """Raise `TestfieldError` where the scene asks for an algorithm or a coefficient that nobody knows."""
    gather(*(partial(_check_known, scene, stage, source) for stage in ALGORITHMS))
    for camera in scene.cameras or (scene.camera,):
        check_held(scene.measure.hold, scene.measure.lens or camera.lens, f"{source}, measure.hold")
    _check_board(scene, source)
    recipe_of(scene).check(f"{source}, measure")


def _check_known(scene: SceneFile, stage: str, source: str) -> None:
    field = stage.removesuffix("s")
    name = getattr(scene.measure, field)
    if name not in names(stage):
        raise TestfieldError(
            f"no {field} is called '{name}'", f"{source}, measure.{field}", nearest(name, names(stage))
        )


def _check_board(scene: SceneFile, source: str) -> None:
    """Raise `TestfieldError` where measure.board names no board, or the calibrator asks for none."""
    board, method = scene.measure.board, scene.measure.calibrator
    if board is None:
        return
    known = [part.name for part in scene.boards]
    if board not in known:
        raise TestfieldError(f"no board is called '{board}'", f"{source}, measure.board", nearest(board, known))
    if "board" not in signature(find("calibrators", method)).parameters:
        raise TestfieldError(
            f"the calibrator '{method}' takes no single board",
            f"{source}, measure.board",
            "leave it out, or choose zhang, opencv or opencv_ro",
        )


def field_key(field: Field) -> str:
    """Key of `field.json`."""
    return digest(field, code_digest("testfield.targets.field"))


def scene_of(folder: Path) -> Path:
    """A run's scene file. Raises `TestfieldError` where the folder is none of a run."""
    path = folder / "scene.toml"
    if not path.is_file():
        raise TestfieldError(
            "no scene.toml here, so this is no run's folder", str(folder), "begin with `testfield run SCENE`"
        )
    return path


def resume(folder: Path, jobs: int) -> Run:
    """The run in a folder that `testfield run` or a person laid out."""
    path = scene_of(folder)
    run = Run(folder, load_scene(path), str(path), Ledger(folder), jobs)
    check_algorithms(run.scene, str(path))
    known = run.ledger.files.get("field.json")
    # Which field a sheet shows, not which code wrote it; earlier versions did not enter it.
    if known is not None and known.world not in ("", digest(run.truth.told)):
        raise TestfieldError(
            "the scene has changed since its field sheet (field.json) was written", str(path), _advice("run", folder)
        )
    return run


def with_seed(text: str, seed: int) -> str:
    """A scene file's text with another seed."""
    return with_values(text, {"seed": seed})


def with_values(text: str, values: Mapping[str, int]) -> str:
    """A scene file's text with other values. Comments are lost: the text is that of the changed document."""
    return tomli_w.dumps(tomllib.loads(text) | dict(values))


def clear(run: Run) -> None:
    """Remove all that the run made, so that it begins again. Frames that it did not make stay."""
    for name in run.ledger.files:
        path = run.folder / name
        inside(run.folder, path)
        if not (name.startswith("frames/") and run.ledger.foreign(name)):
            path.unlink(missing_ok=True)
    run.ledger.path.unlink(missing_ok=True)
    run.ledger = Ledger(run.folder)


def share_radiance(base: Run, run: Run) -> None:
    """Give a run the radiance of another one of the same world, as hard links where the file system has them."""
    for name, entry in base.ledger.files.items():
        if not name.startswith("radiance/") or not base.ledger.undamaged(name) or run.ledger.fresh(name, entry.key):
            continue
        part = part_path(run.folder / name)
        part.parent.mkdir(parents=True, exist_ok=True)
        part.unlink(missing_ok=True)
        try:
            part.hardlink_to(base.folder / name)
        except OSError:
            shutil.copyfile(base.folder / name, part)
        run.ledger.place({name: part}, entry.key, world=entry.world)
    run.ledger.note(images=base.ledger.notes.get("images", {}))


def _advice(maker: str, folder: Path) -> str:
    if maker == "run":
        return f"begin again with `testfield run {folder / 'scene.toml'} --out {folder}`"
    return f"make it with `testfield {maker} {folder}`"
