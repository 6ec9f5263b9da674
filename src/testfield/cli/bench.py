"""`testfield bench render|recall`: this project's parts against their peers."""

import argparse
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser("bench", help="compare with peers in one run, as ratios", description=__doc__)
    p.add_argument(
        "what",
        choices=("render", "recall"),
        help="render: the fast renderer against plain path tracing; recall: targets found and read in clutter",
    )
    p.add_argument(
        "--targets", type=int, default=2000, metavar="N", help="recall: how many are rendered (default: 2000)"
    )
    p.add_argument("--empty", type=int, default=10, metavar="N", help="recall: views without targets (default: 10)")
    p.add_argument("--scene", type=Path, default=Path("scenes/shadowed_board.toml"), metavar="SCENE")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Run the benchmark and print its figures."""
    import json
    import sys

    from testfield.bench.render import bench_render, blurless
    from testfield.scene.build import build_world
    from testfield.scene.load import load_scene

    def tell(what: str) -> None:
        if sys.stderr.isatty():
            print(f"bench: {what}", file=sys.stderr, flush=True)

    if args.what == "recall":
        return _recall(args, tell)
    figures = bench_render(blurless(build_world(load_scene(args.scene))), tell)
    if args.json:
        print(json.dumps(figures))
        return 0
    fast, path = figures["fast"], figures["path"]
    first = f"{figures['figure_of_merit_ratio_first_view']:,.0f}"
    print(f"figure of merit, fast over path     {figures['figure_of_merit_ratio']:,.0f}  (light known)")
    print(f"                                    {first}  (light charged to one view)")
    for name, side in (("fast", fast), ("path", path)):
        print(f"{name}   {side['time_s']:6.2f} s a view   centres {side['centre_rms_px']:.5f} px rms")
    print(f"{figures['dots']} dots; path with {path['samples']} samples a pixel")
    print(f"light  {figures['light_s']:6.2f} s a scene")
    print(f"12 megapixels, 1,000 targets        {figures['view_12_megapixels_1000_targets_s']:.2f} s")
    print(f"time grows as targets^{figures['exponent_of_targets']:.2f}, pixels^{figures['exponent_of_pixels']:.2f}")
    print(f"peak memory                         {figures['peak_memory_gb']:.2f} GB")
    return 0


def _recall(args: argparse.Namespace, tell: Any) -> int:
    import json

    from testfield.bench.recall import bench_recall

    figures = bench_recall(args.targets, args.empty, tell)
    if args.json:
        print(json.dumps(figures))
        return 0
    print(f"found                 {figures['found_percent']:.2f} % of {figures['clear']} targets in clear sight")
    print(f"of these read rightly {figures['decoded_rightly_percent']:.2f} %")
    print(f"wrong numbers         {figures['wrong']} in {figures['rendered']} targets")
    print(f"false finds           {figures['false']} in {figures['views']} views with targets")
    print(f"                      {figures['false_in_empty_views']} in {figures['empty_views']} views without")
    for why, times in figures["missed"].items():
        print(f"missed                {times:>4}  {why}")
    return 0
