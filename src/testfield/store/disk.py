"""What the file system says no to, in one sentence."""

import errno

from testfield.errors import TestfieldError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
GOES_ON = "what is finished is kept, and the same command continues from here"


def spoken(error: OSError) -> TestfieldError:
    """An error of the file system as a sentence: the path, what was said, and what is kept."""
    where = str(error.filename2 or error.filename or "")
    reason = " ".join(f"{error.strerror or error}".split())[:200]
    if error.errno in FULL or "No space left" in reason or "File too large" in reason:
        what = "the disk is full" if error.errno != errno.EFBIG else "no file may become as large as this one"
        return TestfieldError(f"{what} ({reason})", where, f"free some space; {GOES_ON}")
    return TestfieldError(
        f"the file system refuses this ({reason})", where, f"mend it or choose another place; {GOES_ON}"
    )
