"""Leave a sample of the defects in a session of cosmic-ray: `sample.py SESSION COUNT DRAW`, a draw always the same.

All of them take days; a share of a few hundred tells the rate of those that are seen to two in a hundred. A draw whose
survivors have become tests tells that rate no longer: the next one does.

Types are not drawn: `X | None` turned into `X + None` ends the import, or is never evaluated, and tells nothing of the
tests either way. Nor is what is no Python, as `f(^arguments)`: any test at all would see it.
"""

import ast
import json
import random
import sqlite3
import sys
from functools import cache
from itertools import islice
from pathlib import Path

from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

Span = tuple[tuple[int, int], tuple[int, int]]
"""Line and column where something begins, and where it ends."""


def main(session: str, count: int, draw: int) -> None:
    """Delete all but `count` defects."""
    with sqlite3.connect(session) as database:
        jobs, of_types = [], []
        for job, path, *span in database.execute(
            "select job_id, module_path, start_pos_row, start_pos_col, end_pos_row, end_pos_col from mutation_specs "
            "order by module_path, operator_name, occurrence, operator_args"
        ):
            inside = any(a <= tuple(span[:2]) and tuple(span[2:]) <= b for a, b in types_in(path))
            (of_types if inside else jobs).append(job)
        random.Random(draw).shuffle(jobs)
        kept = set(islice((job for job in jobs if is_python(database, job)), count))
        gone = [(job,) for job in jobs + of_types if job not in kept]
        for table in ("mutation_specs", "work_items"):
            database.executemany(f"delete from {table} where job_id = ?", gone)
    print(f"{len(kept)} of {len(jobs)} defects, without {len(of_types)} of types")


def is_python(database: sqlite3.Connection, job: str) -> bool:
    """Whether a mutant can be compiled."""
    path, name, arguments, occurrence = database.execute(
        "select module_path, operator_name, operator_args, occurrence from mutation_specs where job_id = ?", (job,)
    ).fetchone()
    operator = get_operator(name)(**json.loads(json.loads(arguments)))  # cosmic-ray keeps JSON of JSON
    mutant = mutate_code(Path(path).read_text(encoding="utf-8"), operator, occurrence)
    try:
        ast.parse(mutant)
    except SyntaxError:
        return False
    return True


@cache
def types_in(path: str) -> list[Span]:
    """Where annotations stand in a file of source."""
    notes = []
    for node in ast.walk(ast.parse(Path(path).read_text(encoding="utf-8"))):
        if isinstance(node, (ast.arg, ast.AnnAssign)):
            notes.append(node.annotation)
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            notes.append(node.returns)
    return [
        ((note.lineno, note.col_offset), (note.end_lineno or 0, note.end_col_offset or 0))
        for note in notes
        if note is not None
    ]


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
