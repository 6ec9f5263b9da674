"""Choose Mitsuba's variant: CUDA where it works, else LLVM with a library that is known to be usable."""

import os
import sys
from functools import lru_cache
from pathlib import Path
from types import ModuleType

from testfield.errors import TestfieldError
from testfield.render.fetch import listen
from testfield.render.jit_core import VARIABLE, require_fused_arithmetic, set_llvm_target, wanted_llvm_target
from testfield.render.llvm import require_library, usable_library

CUDA, LLVM = VARIANTS = "cuda_ad_mono", "llvm_ad_mono"


@lru_cache
def mitsuba() -> ModuleType:
    """The mitsuba module with its variant set. Call this instead of `import mitsuba`.

    `TESTFIELD_VARIANT` names one of `VARIANTS`, `TESTFIELD_LLVM_TARGET` another processor to make kernels for
    (`jit_core.py`). Raises `TestfieldError` where neither CUDA nor a usable libLLVM is here, saying what to install,
    and where the environment names what is not to be had.
    """
    if "mitsuba" in sys.modules or "drjit" in sys.modules:
        raise TestfieldError("mitsuba was imported before testfield chose its libLLVM", do="import testfield first")
    library = usable_library()
    if library is None and not _cuda_possible():
        require_library()  # says what to install, before Dr.Jit complains in its own words
    # Dr.Jit reads the variable when its LLVM backend starts; a path that cannot load keeps it from
    # searching the system on its own and finding a library that aborts.
    os.environ["DRJIT_LIBLLVM_PATH"] = str(library or "/nonexistent/libLLVM.so")
    import mitsuba as mi

    wanted = os.environ.get("TESTFIELD_VARIANT") or (CUDA if _cuda_works() else LLVM)
    if wanted not in VARIANTS:
        raise TestfieldError(f'"{wanted}" is no variant', "TESTFIELD_VARIANT", f"set it to {' or '.join(VARIANTS)}")
    if wanted == LLVM:
        require_library()
    mi.set_variant(wanted)
    listen()
    target = wanted_llvm_target()
    if wanted == LLVM:
        require_fused_arithmetic()
    if target and wanted != LLVM:
        raise TestfieldError(f"{wanted} is not made by LLVM", VARIABLE, "unset it")
    if target:
        set_llvm_target(target)
    mi.set_log_level(mi.LogLevel.Error)
    return mi


def _cuda_possible() -> bool:
    return Path("/dev/nvidiactl").exists()


def _cuda_works() -> bool:
    if not _cuda_possible():
        return False
    import drjit as dr

    try:
        return bool(dr.has_backend(dr.JitBackend.CUDA)) and int(dr.sum(dr.cuda.Float([1.0, 2.0]))[0]) == 3
    except Exception:  # a broken driver shows itself in many ways, and LLVM serves in all of them
        return False
