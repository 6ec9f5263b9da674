"""Leave a sample of the defects in a session of cosmic-ray: `sample.py SESSION COUNT DRAW`, a draw always the same.

All of them take days; a share of a few hundred tells the rate of those that are seen to two in a hundred. A draw whose
survivors have become tests tells that rate no longer: the next one does.
"""

import random
import sqlite3
import sys


def main(session: str, count: int, draw: int) -> None:
    """Delete all but `count` defects."""
    with sqlite3.connect(session) as database:
        jobs = [
            job
            for (job,) in database.execute(
                "select job_id from mutation_specs order by module_path, operator_name, occurrence, operator_args"
            )
        ]
        kept = set(random.Random(draw).sample(range(len(jobs)), min(count, len(jobs))))
        gone = [(job,) for k, job in enumerate(jobs) if k not in kept]
        for table in ("mutation_specs", "work_items"):
            database.executemany(f"delete from {table} where job_id = ?", gone)
    print(f"{len(kept)} of {len(jobs)} defects")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
