"""What Dr.Jit's core library offers and its Python module does not, above all the processor that kernels are made for.

`TESTFIELD_LLVM_TARGET` names it. A processor can make kernels for lesser ones of its kind, so one machine shows what
others will do: vectors of another width, instructions that round or fail in other ways.
"""

import ctypes
import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from testfield.errors import TestfieldError

VARIABLE = "TESTFIELD_LLVM_TARGET"


@dataclass(frozen=True)
class Target:
    """A level of the x86-64 psABI: `width` floats in a vector register, features beyond it to use (`more`), and what a
    processor must have to run its kernels (`needs`), all in LLVM's words."""

    width: int
    needs: frozenset[str]
    more: str = ""


TARGETS = {
    # Dr.Jit ends the process where fused multiplication and addition is a call into the C library, so it is added.
    "x86-64-v2": Target(4, frozenset({"sse4.2", "fma"}), "+fma"),
    "x86-64-v3": Target(8, frozenset({"avx2", "fma", "bmi2", "f16c"})),
    "x86-64-v4": Target(16, frozenset({"avx512f", "avx512bw", "avx512dq", "avx512vl"})),
}


@lru_cache
def _library() -> ctypes.CDLL:
    import drjit

    names = ("libdrjit-core.so", "libdrjit-core.dylib", "drjit-core.dll")
    folder = Path(drjit.__file__).parent
    return ctypes.CDLL(str(next(folder / name for name in names if (folder / name).exists())))


def core_function(name: str, mangled: str, result: Any, *arguments: Any) -> Any:
    """A function of the library, which exports some by their plain and some by their C++ name (Itanium ABI)."""
    library = _library()
    try:
        function = getattr(library, name, None) or library[f"_Z{len(name)}{name}{mangled}"]
    except AttributeError:
        raise TestfieldError(f"this Dr.Jit has no {name}", str(library._name), "install Dr.Jit 1.5") from None
    function.restype, function.argtypes = result, arguments
    return function


def set_llvm_target(name: str) -> None:
    """Make all kernels from now on for one of `TARGETS`.

    Call it once the variant is set. Raises `TestfieldError` where the name is another, or this machine is no such one.
    """
    target = TARGETS.get(name)
    if target is None:
        raise TestfieldError(f'"{name}" is no target', VARIABLE, f"set it to one of {', '.join(TARGETS)}, or unset it")
    missing = target.needs - {flag[1:] for flag in llvm_features().split(",") if flag.startswith("+")}
    if missing:
        lacks = f"this processor lacks {', '.join(sorted(missing))}, which kernels for {name} use"
        raise TestfieldError(lacks, VARIABLE, "unset it")
    set_target = core_function(
        "jit_llvm_set_target", "PKcS0_j", None, ctypes.c_char_p, ctypes.c_char_p, ctypes.c_uint32
    )
    set_target(name.encode(), target.more.encode() or None, target.width)


def require_fused_arithmetic() -> None:
    """Raise `TestfieldError` on an x86 processor without FMA: there Dr.Jit ends the process at the first kernel."""
    has = llvm_features()
    if "+sse2" in has and "+fma" not in has.split(","):
        raise TestfieldError("this processor cannot multiply and add in one (FMA)", do="render on one of 2013 or later")


def llvm_target() -> tuple[str, int]:
    """The processor for which kernels are made, and the floats in one of its vectors."""
    cpu = core_function("jit_llvm_target_cpu", "v", ctypes.c_char_p)()
    return (cpu or b"").decode(), int(core_function("jit_llvm_vector_width", "v", ctypes.c_uint32)())


def llvm_features() -> str:
    """What LLVM knows of the processor: `+sse4.2,-avx512f,...`; empty once another target is set."""
    return (core_function("jit_llvm_target_features", "v", ctypes.c_char_p)() or b"").decode()


def wanted_llvm_target() -> str | None:
    """The target that the environment names."""
    return os.environ.get(VARIABLE) or None
