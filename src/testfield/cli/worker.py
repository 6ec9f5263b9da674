"""`testfield worker ADDRESS`: processes of this machine that do cases for `--cluster ADDRESS`."""

import argparse
from pathlib import Path
from typing import Any

from testfield.cli.show import add_load


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "worker", help="serve a scheduler of Dask: do cases for commands given --cluster", description=__doc__
    )
    p.add_argument(
        "address", metavar="ADDRESS", help="of the scheduler, as `dask scheduler` prints it: tcp://host:port"
    )
    p.add_argument("--jobs", type=int, default=1, metavar="N", help="processes, of one thread each (default: 1)")
    p.add_argument("--memory-gb", type=float, metavar="GB", help="for each; one that needs more is begun again")
    p.add_argument("--scratch", type=Path, metavar="FOLDER", help="for files that only it sees (default: here)")
    p.add_argument(
        "--patience",
        type=float,
        default=60.0,
        metavar="S",
        help="ends when the scheduler is away so long (default: 60)",
    )
    add_load(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Serve until the scheduler has gone."""
    from testfield.cli.show import jobs_of
    from testfield.cluster.worker import serve
    from testfield.errors import TestfieldError

    if args.memory_gb is not None and not args.memory_gb > 0:
        raise TestfieldError(f"value {args.memory_gb:g} is not positive", "--memory-gb", "give more than 0")
    if not args.patience >= 0:
        raise TestfieldError(f"value {args.patience:g} is negative", "--patience", "give 0 or more")
    serve(args.address, jobs_of(args.jobs), args.memory_gb, args.scratch, args.patience)
    return 0
