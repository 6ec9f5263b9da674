"""Arithmetic that does not depend on how many threads there are."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """BLAS uses one thread: of several, each adds its own part, and the sum's last digits depend on their number."""
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@cache
def _libraries() -> Any:
    """Looked for once: that takes longer than many an adjustment's step."""
    import scipy.linalg  # noqa: F401  # brings a BLAS of its own, which must be there to be told
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
