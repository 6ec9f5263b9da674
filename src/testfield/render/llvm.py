"""Find a libLLVM that Mitsuba can use, before Mitsuba is imported.

Dr.Jit loads whatever libLLVM the system offers, and versions before 17 abort the whole process at the first render
(`Cannot select: fminimum`). So the version is asked for in a process of its own, and only a usable library is ever
named to Dr.Jit.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

from testfield.errors import TestfieldError

OLDEST_USABLE = 17
PLACES = (
    "/usr/lib/*-linux-gnu/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/usr/lib64/llvm*/lib*/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
    "/opt/homebrew/opt/llvm*/lib/libLLVM*.dylib",
)
_ASK = (
    "import ctypes,sys;v=(ctypes.c_uint*3)();"
    "ctypes.CDLL(sys.argv[1]).LLVMGetVersion(v,ctypes.byref(v,4),ctypes.byref(v,8));print(v[0])"
)


def version_of(library: Path) -> int:
    """Major version that a libLLVM reports of itself; 0 where it cannot be loaded or is too old to say."""
    asked = subprocess.run([sys.executable, "-S", "-c", _ASK, str(library)], capture_output=True, text=True)
    return int(asked.stdout) if asked.returncode == 0 else 0


def candidates() -> list[Path]:
    """Every libLLVM on this system, newest name first, each file once; one named by the user comes before all."""
    found = {path.resolve() for place in PLACES for path in Path("/").glob(place.lstrip("/"))}

    def newest_first(path: Path) -> tuple[int, str]:
        number = re.search(r"(\d+)", path.name)
        return (-int(number.group(1)) if number else 0, str(path))

    ordered = sorted(found, key=newest_first)
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    return ([Path(named)] if named else []) + ordered


def usable_library() -> Path | None:
    """The libLLVM to use, or None where no usable one is installed."""
    return next((path for path in candidates() if version_of(path) >= OLDEST_USABLE), None)


def require_library() -> Path:
    """As `usable_library`, but an absent one is an error that says what to install."""
    library = usable_library()
    if library is None:
        raise TestfieldError(
            f"no CUDA device and no libLLVM of version {OLDEST_USABLE} or later",
            do="install one (Debian, Ubuntu: apt-get install libllvm19), or set DRJIT_LIBLLVM_PATH to it",
        )
    return library


def main() -> int:
    """Exit status 0 where a renderer can run here: with CUDA, or with a usable libLLVM."""
    if Path("/dev/nvidiactl").exists() or usable_library():
        return 0
    if "--quiet" not in sys.argv:
        try:
            require_library()
        except TestfieldError as error:
            print(f"setup: {error}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
