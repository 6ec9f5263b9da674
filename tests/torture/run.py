"""`make torture`: mutated inputs, kills at random moments, two processes on one folder; a table at the end.

What is done is kept in the folder, and the same command goes on from there. Exit status 1 where anything was wrong.
"""

import argparse
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
SCENES = HERE.parents[1] / "scenes"


def sound_folder(folder: Path) -> Path:
    """A small finished run with meshes, photographs, a field file and algorithms of one's own beside it; made once, of
    the run in `folder`/finished if there is one."""
    from own import make_own
    from sound import make_sound

    if not (folder / "sound.done").exists():
        shutil.rmtree(folder / "sound", ignore_errors=True)
        if (folder / "finished").exists():
            shutil.copytree(folder / "finished", folder / "sound")
        else:
            command = [sys.executable, "-m", "testfield", "run", str(HERE / "tiny.toml")]
            subprocess.run([*command, "--out", str(folder / "sound"), "--jobs", "1"], check=True, capture_output=True)
        make_sound(folder / "sound")
        make_own(folder / "sound")
        (folder / "sound.done").touch()
    return folder / "sound"


def table(title: str, rows: list[dict[str, Any]], by: str) -> int:
    """Print how many were right of each kind; returns how many were wrong."""
    print(f"{title:<24} {'done':>6} {'wrong':>6}  status")
    for name in dict.fromkeys(row[by] for row in rows):
        own = [row for row in rows if row[by] == name]
        status = Counter(str(row.get("status", "")) for row in own)
        shown = ", ".join(f"{code}: {n}" for code, n in sorted(status.items()) if code)
        print(f"{name:<24} {len(own):>6} {sum(bool(row['wrong']) for row in own):>6}  {shown}")
    bad = [row for row in rows if row["wrong"]]
    for row in bad[:40]:
        print(f"  {row[by]}: {row['wrong']}")
    return len(bad)


def main() -> int:
    """Do what is missing and print the table."""
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("--inputs", type=int, default=10_000)
    p.add_argument("--only", default="", help="readers with this text in their names")
    p.add_argument("--kills", type=int, default=100)
    p.add_argument("--pairs", type=int, default=20)
    p.add_argument("--cluster", type=int, default=30, help="kills of workers, schedulers and parents of a cluster")
    p.add_argument("--scene", type=Path, default=SCENES / "quick.toml", help="what is killed, and run twice at once")
    p.add_argument("--out", type=Path, default=Path("renders/torture"))
    args = p.parse_args()
    folder = args.out.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    bad = 0
    if args.inputs:
        from inputs import feed

        bad += table("mutated inputs", feed(args.inputs, folder, sound_folder(folder), args.only), "reader")
    if args.kills or args.pairs:
        from ends import kills, pairs

        bad += table("ends", kills(args.kills, args.scene, folder) + pairs(args.pairs, args.scene, folder), "way")
    if args.cluster:
        from cluster import kills as cluster_kills

        bad += table("ends of a cluster", cluster_kills(args.cluster, folder), "way")
    print(f"{bad} wrong")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
