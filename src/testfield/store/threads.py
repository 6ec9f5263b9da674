"""Arithmetic that does not depend on how many threads there are."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """BLAS uses one thread: of several, each adds its own part, and the sum's last digits depend on their number."""
    import scipy.linalg  # noqa: F401  # brings a BLAS of its own, which must be there to be told
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"):
        yield
