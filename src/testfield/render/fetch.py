"""What kernels computed, as NumPy arrays, unless Dr.Jit complained while it computed them.

Dr.Jit does not raise where it has left out what it cannot do or knows to be wrong: it writes a line to its log and goes
on. On a GPU, for instance, it lets rays miss where a kernel traces in two scenes.
"""

import atexit
import ctypes
import sys
from typing import Any

import numpy as np

from testfield.errors import TestfieldError
from testfield.render.jit_core import core_function

NOTHING, ERROR, WARNING = 0, 1, 2
"""Dr.Jit's levels of messages."""
GRAVE = ("undefined behavior", "out-of-bounds", "out of bounds", "attempted to invoke")
"""In warnings that say that a result is wrong; others tell of speed, memory and caches."""
MOST_SHOWN = 300

_complaints: list[str] = []


@ctypes.CFUNCTYPE(None, ctypes.c_uint32, ctypes.c_char_p)
def _hear(level: int, text: bytes) -> None:
    message = " ".join((text or b"").decode(errors="replace").split())
    if level <= ERROR or any(word in message.lower() for word in GRAVE):
        _complaints.append(message)
    else:
        print(message, file=sys.stderr)


def listen() -> None:
    """Hear Dr.Jit's messages from now on. Where its library offers no way to, it goes on writing them itself."""
    callback = type(_hear)
    try:
        tell = core_function("jit_set_log_level_callback", "8LogLevelPFvS_PKcE", None, ctypes.c_uint32, callback)
    except TestfieldError:
        return
    tell(WARNING, _hear)
    # What Dr.Jit says while the process ends would call an interpreter that is no more.
    atexit.register(tell, NOTHING, callback())


def fetch(values: Any) -> np.ndarray:
    """A device array on the host, computed if it is not yet.

    Raises `TestfieldError` where Dr.Jit has said since the last call that a result is wrong.
    """
    fetched = np.asarray(values)
    if _complaints:
        first, more = _complaints[0][:MOST_SHOWN], len(_complaints) - 1
        _complaints.clear()
        others = f" (and {more} more)" if more else ""
        raise TestfieldError(f"Dr.Jit says that what it computed is wrong: {first}{others}", "rendering", "report this")
    return fetched
