"""Public sets of photographs, one line each: found, wrong, residual, time; what fails is listed with its reason.

    python tests/photograph_sets.py FOLDER [--out OUT] [--only WORD ...]

FOLDER holds work trees of the repositories in `SETS`, each as owner+name; a set that is not there is said to be absent.
Every set goes through the command that its line names, by this interpreter; what is finished in OUT is not done again.
"""

import argparse
import json
import resource
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testfield.detect.observations import MEASURED, READ, Observations

SHARED = Path("../shared/real")
BOOF = "lessthanoptimal+BoofCV-Data/example/calibration"
MONO, STEREO = f"{BOOF}/mono", f"{BOOF}/stereo"
APRIL = "powei-lin+aprilgrid-rs/tests/data"
SWAT = "swatbotics+apriltag/images"
LIMIT_S = 900
FAR_PX = 3.0
"""A point of a board that lies farther from a smooth map of the board is wrong."""


@dataclass(frozen=True)
class Set:
    """A set: its files under FOLDER (patterns), what the photographs show, how many points or tags are there to be
    found (0 where nobody knows), and the words of the command; `none` why no kind of target describes it."""

    name: str
    files: tuple[str, ...]
    kind: str = ""
    there: int = 0
    words: tuple[str, ...] = ("detect",)
    right: Callable[[Path], dict[str, set[int]]] | None = None
    none: str = ""


def _plate(folder: Path) -> dict[str, set[int]]:
    """Numbers that may be read: those on the plate."""
    return {"": set(range(2, 75))}


def _hall(folder: Path) -> dict[str, set[int]]:
    """The tags that hang there, image by image, as the set's own list has them."""
    lines = (folder / SWAT / "mapping_feb_2014/groundtruth.txt").read_text().splitlines()
    return {line.split()[0].rsplit(".", 1)[0]: set(map(int, line.split()[1:])) for line in lines if line.strip()}


HELD = ("measure", "--hold", "k3")
ECO = "ECoCheck, a checkerboard with bits of its own in the white squares: no kind of target"
SETS = (
    Set("micmac plate", ("ring14_plate",), "ring14", 162, ("measure", "--field", "plate"), _plate),
    Set("BoofCV circles, Sony HX5V", ("circle_grid",), "circles:10x8:25:15", 480, HELD),
    Set("BoofCV checkerboard, Sony HX5V", (f"{MONO}/Sony_DSC-HX5V_Chess",), "checkerboard:6x4:30", 312, HELD),
    Set(
        "BoofCV checkerboard, Bumblebee2",
        (f"{STEREO}/Bumblebee2_Chess/left*.jpg", f"{STEREO}/Bumblebee2_Chess/right*.jpg"),
        "checkerboard:6x4:30",
        528,
        (*HELD, "--by-folder"),
    ),
    Set(
        "BoofCV hexagonal circles, Sony HX5V",
        (f"{MONO}/Sony_DSC-HX5V_CircleHexagonal",),
        "hexcircles:14x24:12:10",
        7 * 336,
        HELD,
    ),
    Set(
        "BoofCV checkerboard, fisheye",
        (f"{BOOF}/fisheye/chessboard",),
        "checkerboard:6x4:30",
        26 * 24,
        ("measure", "--lens", "fisheye"),
    ),
    Set("swatbotics checkerboard", (f"{SWAT}/mapping_feb_2014/calibration",), "checkerboard:7x5:30", 17 * 35, HELD),
    Set("swatbotics AprilTags, a hall", (f"{SWAT}/mapping_feb_2014",), "apriltag:36h11", 0, ("detect",), _hall),
    Set("Kalibr's AprilGrid, EuRoC", (f"{APRIL}/EuRoC.png",), "aprilgrid:6x6:88:26.4", 144),
    Set(
        "Kalibr's AprilGrid, TUM VI fisheye",
        tuple(f"{APRIL}/{name}.png" for name in ("TUM_VI", "r45", "right", "top", "top_right")),
        "aprilgrid:6x6:88:26.4",
        5 * 144,
    ),
    Set("AprilGrid on a screen, telephone", (f"{APRIL}/iphone.png",), "aprilgrid:11x6:30:9", 264),
    Set(
        "pettod ChArUco", ("pettod+charuco-corner-detection/test_data/im?.jpg",), "charuco:12x9:DICT_5X5_100:35:25", 176
    ),
    Set(
        "Barry-Liang checkerboard, left camera",
        ("Barry-Liang+stereoCalibrate/left*.jpg",),
        "checkerboard:9x6:30",
        1350,
        HELD,
    ),
    Set(
        "stereo pair, checkerboard held by hand",
        ("kisron86+MTBR-PENS/BACKUP-1/stereo/sample_images",),
        "checkerboard:5x4",
        40,
    ),
    Set("CCTags, AliceVision", ("alicevision+CCTag/sample",), "cctag:3"),
    Set(
        "BoofCV squares, PULNiX (Zhang's)",
        (f"{MONO}/PULNiX_CCD_6mm_Zhang",),
        "squares:8x8:22.5778:12.7",
        5 * 256,
        ("measure", "--hold", "k3,p1,p2"),
    ),
    Set("BoofCV squares, Sony HX5V", (f"{MONO}/Sony_DSC-HX5V_Square",), "squares:4x3:60:30", 14 * 48, HELD),
    Set(
        "BoofCV squares, Bumblebee2",
        (f"{STEREO}/Bumblebee2_Square/left*.jpg", f"{STEREO}/Bumblebee2_Square/right*.jpg"),
        "squares:4x3:60:30",
        26 * 48,
        (*HELD, "--by-folder"),
    ),
    Set(
        "BoofCV squares, fisheye",
        (f"{BOOF}/fisheye/square_grid",),
        "squares:4x3:60:30",
        22 * 48,
        ("measure", "--lens", "fisheye"),
    ),
    Set("BoofCV ECoCheck, Zed", (f"{STEREO}/Zed_ecocheck",), none=ECO),
    Set("BoofCV ECoCheck, three cameras", (f"{BOOF}/trinocular/left",), none=ECO),
    Set(
        "BoofCV ArUco 25h7",
        ("lessthanoptimal+BoofCV-Data/example/fiducial/square_hamming/aruco_25h7",),
        none="ArUco's 25h7 is none of OpenCV's dictionaries",
    ),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("renders/sets"))
    parser.add_argument("--only", nargs="+", default=[""])
    args = parser.parse_args()
    titles = ("photographs", "kind", "images", "found", "wrong or turned down", "residual, rms", "CPU", "")
    print(f"| {' | '.join(titles)} |\n{'|---' * len(titles)}|")
    for one in SETS:
        if any(word in one.name for word in args.only):
            print(line(one, args.folder, args.out / one.name.replace(" ", "_").replace("'", "")), flush=True)


def line(one: Set, folder: Path, out: Path) -> str:
    """A set's line."""
    files = [path for pattern in one.files for path in _files(folder, pattern)]
    head = f"| {one.name} | {f'`{one.kind}`' if one.kind else 'none'} | {len(files)} |"
    if not files:
        return f"{head} | | | | not there |"
    if one.none:
        return f"{head} 0 | 0 | | | {one.none} |"
    kept = out / "line.json"
    if not kept.exists():
        out.mkdir(parents=True, exist_ok=True)
        rc, seconds, said = _run(one, files, out)
        kept.write_text(json.dumps({"rc": rc, "cpu_s": seconds, "said": said}))
    told = json.loads(kept.read_text())
    found, wrong, residual, notes = _read(one, folder, out)
    if told["rc"]:
        notes = [told["said"][-1] if told["said"] else f"exit status {told['rc']}", *notes]
    there = f" of {one.there}" if one.there else ""
    return f"{head} {found}{there} | {wrong} | {residual} | {told['cpu_s']:.0f} s | {'; '.join(notes)} |"


def _files(folder: Path, pattern: str) -> list[Path]:
    root = folder if (folder / pattern.split("/")[0]).exists() else SHARED
    paths = sorted(root.glob(pattern)) if "*" in pattern or "?" in pattern else [root / pattern]
    found = [file for path in paths for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
    return [
        f for f in found if f.is_file() and f.suffix.lower() in (".jpg", ".png", ".tif") and "expected" not in f.name
    ]


def _run(one: Set, files: list[Path], out: Path) -> tuple[int, float, list[str]]:
    """The command on a set: exit status, seconds of CPU, and its last lines."""
    what, *options = one.words
    given: list[str] = [str(file) for file in files]
    if "--by-folder" in options:
        given = []
        for k, pattern in enumerate(one.files):
            camera = out / "images" / f"camera{k + 1}"
            camera.mkdir(parents=True, exist_ok=True)
            for file in files:
                if file.match(pattern.rsplit("/", 1)[1]):
                    (camera / file.name).unlink(missing_ok=True)
                    (camera / file.name).symlink_to(file.resolve())
            given.append(str(camera))
    if "plate" in options:
        options = ["--field", "scenes/fields/plate.toml"]
    else:
        options += ["--target", one.kind]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "testfield", what, *given, *options, "--out", str(out)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
        rc, said = done.returncode, done.stderr.strip().splitlines()[-1:]
    except subprocess.TimeoutExpired:
        rc, said = 124, [f"not ended after {LIMIT_S} s"]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return rc, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, said


def _read(one: Set, folder: Path, out: Path) -> tuple[str, str, str, list[str]]:
    """Found, wrong, residual, and notes."""
    if not (out / "observations.parquet").exists():
        return "0", "", "", []
    o = Observations.load(out / "observations.parquet")
    notes = []
    seen = np.isin(o.status.astype(str), (MEASURED, READ)) & np.isfinite(o.xy_px).all(axis=1)
    read = int((o.status[seen] == READ).sum())
    if read:
        notes.append(f"{read} as they were read")
    residual = ""
    answer = out / "measurement.json"
    if answer.exists():
        told = json.loads(answer.read_text())
        u = told.get("interior_u", {})
        residual = f"{told['reprojection_rms_px']:.3f} px"
        if "interior" in told and "fx" in u:
            notes.append(f"fx {told['interior']['fx']:.2f} px, u {u['fx']:.2f}")
        notes.append(f"{len(told['joined'])} images joined")
    if one.right is not None:
        right = one.right(folder)
        tags = {(o.stations[s], c) for s, c in zip(o.station[seen], o.code[seen], strict=True) if c >= 0}
        if "" in right:
            return (
                str(len([1 for _, c in tags if c > 0])),
                str(sum(c > 0 and c not in right[""] for _, c in tags)),
                residual,
                notes,
            )
        wanted = {(name, c) for name, numbers in right.items() for c in numbers}
        known = {tag for tag in tags if tag[0] in right}
        return f"{len(known & wanted)} of {len(wanted)} tags", str(len(known - wanted)), residual, notes
    if one.kind.startswith("cctag"):
        return f"{int(seen.sum())} tags {sorted(o.code[seen].tolist())}", "", residual, notes
    wrong, errors = 0, []
    for s in range(len(o.stations)):
        mine = np.flatnonzero(seen & (o.station == s) & (o.point >= 0))
        off = _off(o.point[mine], o.xy_px[mine], one)
        wrong += int((off > FAR_PX).sum())
        errors.append(off[off <= FAR_PX])
    if answer.exists():  # the lens is in the adjustment, not in the map
        wrong = len(json.loads(answer.read_text())["rejected"])
    if not residual and errors:
        residual = f"{np.sqrt(np.mean(np.concatenate(errors) ** 2) / 2):.3f} px from a smooth map"
    found = Counter(o.station[seen & (o.point >= 0)].tolist())
    return str(sum(found.values())), str(wrong), residual, notes


def _off(point: np.ndarray, xy_px: np.ndarray, one: Set) -> np.ndarray:
    """(n,) distances in px of a board's points from a smooth map of the board: polynomials of the third degree (of the
    fifth where a lens bends more), fitted without those that are far off."""
    from testfield.detect.target_spec import parse_target
    from testfield.measure.patterns import board_pattern

    at = board_pattern(parse_target(one.kind)).points_mm[point]
    if len(at) < 20:
        return np.zeros(len(at))
    x, y = ((at - at.mean(axis=0)) / np.abs(at - at.mean(axis=0)).max()).T
    degree = 5 if len(at) > 100 else 3
    design = np.column_stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)])
    use, off = np.ones(len(at), bool), np.zeros(len(at))
    for _ in range(5):
        fit = np.linalg.lstsq(design[use], xy_px[use], rcond=None)[0]
        off = np.linalg.norm(design @ fit - xy_px, axis=1)
        use = off < max(FAR_PX, 3 * float(np.median(off)))
    return off


if __name__ == "__main__":
    main()
