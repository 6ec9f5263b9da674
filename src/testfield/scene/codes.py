"""The table of ring codes that a scene names."""

from pathlib import Path

from testfield.errors import TestfieldError
from testfield.scene.schema import SceneFile
from testfield.targets.code_table import CodeTable, load_code_table, table_path

COPY = "codes"
"""Name, without its suffix, of the copy of a table's file in a run's folder."""


def copy_name(file: str) -> str:
    """Name of the copy of a table's file in a run's folder."""
    return f"{COPY}{Path(file).suffix or '.csv'}"


def codes_path(file: str, folder: Path) -> Path:
    """Where a table's file is: as the scene in `folder` names it, in a run's folder the copy made when it was run, or
    shipped."""
    copy = folder / copy_name(file)
    return copy if not (folder / file).exists() and copy.is_file() else table_path(file, folder)


def codes_of(scene: SceneFile) -> CodeTable | None:
    """The table of a scene that names one. Raises `TestfieldError`."""
    if scene.code_table is None:
        return None
    table = load_code_table(codes_path(scene.code_table, scene.folder))
    if "code_bits" in scene.model_fields_set and scene.code_bits != table.bits:
        raise TestfieldError(
            f"the words of {table.title} have {table.bits} bits, not {scene.code_bits}", "code_bits", "leave it out"
        )
    return table
