"""Whether a worker has the program that its parent has: versions of all that decides figures."""

import os
import platform
import sys
from collections.abc import Mapping
from functools import cache

from testfield.store.code import PACKAGES, package_version
from testfield.version import __version__

CHOSEN_BY = ("TESTFIELD_VARIANT", "TESTFIELD_LLVM_TARGET")
"""Variables that choose which kernels render."""


@cache
def program() -> Mapping[str, str]:
    """What decides figures, by name: the program, Python and packages in their versions, and how images are rendered.

    What algorithms do is not among them: each case's key says that of the code that it uses (`evaluate/keys`).
    """
    versions = {name: package_version(name) for name in (*PACKAGES, "pycolmap")}
    chosen = {name: os.environ.get(name, "") for name in CHOSEN_BY}
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    return {"testfield": __version__, "Python": python} | versions | chosen


def differences(wanted: Mapping[str, str]) -> str:
    """What of this process' program is not as wanted, in words; empty where all is."""
    here = program()
    return ", ".join(
        f"{name} {here.get(name) or 'unset'} instead of {value or 'unset'}"
        for name, value in wanted.items()
        if here.get(name) != value
    )


def host() -> str:
    """This machine, as a person knows it."""
    return f"worker {os.getpid()} on {platform.node()}"
