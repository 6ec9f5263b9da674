"""The options `--cluster` and `--store` of commands that take cases."""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any


def add_cluster(parser: argparse.ArgumentParser, store: bool = True) -> None:
    """The options, the second one where results need not stand in the command's own folder."""
    parser.add_argument(
        "--cluster",
        metavar="WHERE",
        help="do the work on many machines: tcp://host:port of a scheduler (`testfield worker` serves it), or a file "
        "like slurm.toml for a batch system (FORMATS.md)",
    )
    if store:
        parser.add_argument(
            "--store",
            metavar="PLACE",
            help="with --cluster: where all machines keep finished cases, a folder or a URL like s3://bucket/place "
            "(default: the command's folder, which all must see)",
        )


@contextmanager
def cluster_of(args: argparse.Namespace, folder: Path) -> Iterator[Any]:
    """The pool that a command line asks for, None where it asks for none. Raises `TestfieldError` as `opened` does."""
    from testfield.errors import TestfieldError

    store = getattr(args, "store", None)
    if args.cluster is None:
        if store is not None:
            raise TestfieldError("this is for a cluster", "--store", "give --cluster too, or leave it out")
        yield None
        return
    from testfield.chain.progress import say, step
    from testfield.cluster.opened import opened

    with ExitStack() as stack:
        say("cluster", f"asking {args.cluster} for processes")
        with step("cluster"):  # a batch system may let jobs wait for an hour
            pool = stack.enter_context(opened(args.cluster, store, folder))
        dashboard = f", dashboard {pool.dashboard}" if pool.dashboard else ""
        say("cluster", f"{pool.processes()} processes at {args.cluster}{dashboard}")
        yield pool
