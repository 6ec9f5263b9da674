"""A scene from beginning to end: its folder laid out, every stage done, as the command `run` and `tf.run` do it."""

from collections.abc import Callable
from pathlib import Path

from testfield.chain.progress import step
from testfield.chain.rendering import refuse_frames_of_others
from testfield.chain.run import Run, checked, clear, lay_out, share_radiance
from testfield.chain.stages import STAGES, run_stage
from testfield.scene.changes import Change
from testfield.scene.document import Document
from testfield.store.lock import only_writer
from testfield.store.work import local_pool

SILENT = ("calibrate", "reconstruct", "score")
"""Stages that are one step, and show no progress of their own."""


def complete(
    scene: Path | Document,
    out: Path | None = None,
    seed: int | None = None,
    noise_seed: int | None = None,
    jobs: int = 1,
    force: bool = False,
    warn: Callable[[list[str]], None] = lambda warnings: None,
    stages: tuple[str, ...] = tuple(STAGES),
    changes: tuple[Change, ...] = (),
) -> tuple[Run, bool]:
    """The run of a scene with its `stages` finished, and whether anything had to be made. `warn` is told the scene's
    warnings first.

    `changes` of the scene are for this run alone.

    With a `noise_seed` the world is rendered in its own folder, and its radiance shared. With `force` all that the run
    itself made is made again. Raises `TestfieldError` as `checked` does, and where frames of others would be touched.
    """
    base, content, warnings = checked(scene, out, seed, jobs, changes=changes)
    run = base
    if noise_seed is not None:
        run, noise_content, _ = checked(scene, out, seed, jobs, noise_seed, changes)
    warn(warnings)
    if run.folder == base.folder:
        with only_writer(run.folder):
            return run, _do(base, content, warnings, force, stages)
    with only_writer(base.folder), only_writer(run.folder):
        made = _do(base, content, warnings, force, ("render",))
        _begin(run, noise_content, warnings, force)
        share_radiance(base, run)
        return run, _do(run, noise_content, warnings, False, stages) or made


def stage(run: Run, name: str) -> bool:
    """Do one stage; whether it made anything. Where it takes long, lines say that it goes on."""
    if name in SILENT:
        with step(name):
            return run_stage(run, name)
    return run_stage(run, name)


def _do(run: Run, content: bytes, warnings: list[str], force: bool, stages: tuple[str, ...]) -> bool:
    _begin(run, content, warnings, force)
    with local_pool(run.jobs) as run.pool:  # its processes begin with the first stage that asks for them
        made = any([stage(run, name) for name in stages])
    run.pool = None
    return made


def _begin(run: Run, content: bytes, warnings: list[str], force: bool) -> None:
    """Lay out a run's folder, emptied first where that is asked for.

    Frames of somebody's own are refused before anything is removed, or rendered in vain.
    """
    refuse_frames_of_others(run)
    if force:
        clear(run)
    lay_out(run, content, warnings)
