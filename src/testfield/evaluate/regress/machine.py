"""What figures were made with: commit, processor, versions of packages, renderer."""

import os
import platform
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

from testfield.evaluate.provenance import processor
from testfield.score.floor import renderer_digest
from testfield.store.code import PACKAGES, package_version
from testfield.version import __version__


@cache
def machine(folder: Path) -> dict[str, Any]:
    """By name: `commit` of a folder's repository (empty where it is none), `processor`, `target` (what the kernels
    are made for where it is not this processor), `versions` by package, and the digest of `renderer` and sensor."""
    return {
        "commit": commit(folder),
        "processor": f"{processor()}, {platform.machine()}",
        "target": os.environ.get("TESTFIELD_LLVM_TARGET", "") + os.environ.get("TESTFIELD_VARIANT", ""),
        "versions": {
            "testfield": __version__,
            "python": platform.python_version(),
            **{name: package_version(name) for name in PACKAGES},
        },
        "renderer": renderer_digest()[:16],
    }


def commit(folder: Path) -> str:
    """The commit of a folder's repository, with + where files have changed since; empty where there is none."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True, timeout=20)
        return done.stdout.strip() if done.returncode == 0 else ""

    try:
        head = git("rev-parse", "HEAD")
        return head + ("+" if head and git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return ""
