"""`testfield bench render`: this project's parts against their peers."""

import argparse
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser("bench", help="compare with peers in one run, as ratios", description=__doc__)
    p.add_argument("what", choices=("render",), help="render: the fast renderer against plain path tracing")
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
