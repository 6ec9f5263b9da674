"""Normal equations of many small fits: their sums, in compiled functions, and their inverses."""

import numpy as np

from testfield.store.compiled import compiled

CHUNK = 264
"""Pixels whose derivatives are gathered before they are multiplied: few enough to stay in the processor's cache."""
LEAST_PIVOT = 1e-8
"""Of a matrix of unit diagonal: below this in Cholesky's factorisation something is hardly told by the data."""
NOT_TOLD = 1e-11
"""Eigenvalues, as parts of the largest, of what is not told at all, and stays as it is."""


@compiled
def add_products(
    jacobian: np.ndarray, weight: np.ndarray, residual: np.ndarray, normal: np.ndarray, gradient: np.ndarray
) -> None:
    """Add what `CHUNK` pixels contribute to a normal matrix (p, p) and its right side (p,): derivatives (p, CHUNK),
    weights and residuals (CHUNK,). Weights are set to zero, so that what is not written anew counts no more."""
    weighted = np.empty_like(jacobian)
    for a in range(len(jacobian)):
        for k in range(len(weight)):
            weighted[a, k] = jacobian[a, k] * weight[k]
    normal += np.dot(weighted, jacobian.T)
    gradient += np.dot(weighted, residual)
    for k in range(len(weight)):
        weight[k] = 0


def inverse(normal: np.ndarray) -> np.ndarray:
    """Inverses of normal matrices (n, p, p), whatever their parameters' units; what the data do not tell stays as it
    is."""
    found, whole = by_cholesky(np.ascontiguousarray(normal))
    rest = np.flatnonzero(~whole)
    if len(rest):
        diagonal = np.einsum("nii->ni", normal[rest])
        scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1))
        unit = np.nan_to_num(normal[rest] * scale[:, :, None] * scale[:, None, :])
        found[rest] = np.linalg.pinv(unit, NOT_TOLD, hermitian=True) * scale[:, :, None] * scale[:, None, :]
    return found


@compiled
def by_cholesky(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverses (n, p, p), and (n,) whether they are any."""
    n, p = normal.shape[0], normal.shape[1]
    found, whole = np.empty((n, p, p)), np.ones(n, np.bool_)
    scale, factor, turned = np.empty(p), np.empty((p, p)), np.empty((p, p))
    for i in range(n):
        for a in range(p):
            scale[a] = 1 / np.sqrt(max(normal[i, a, a], 1e-300))
        for a in range(p):
            for b in range(a + 1):
                rest = normal[i, a, b] * scale[a] * scale[b]
                for k in range(b):
                    rest -= factor[a, k] * factor[b, k]
                if a > b:
                    factor[a, b] = rest / factor[b, b]
                elif rest > LEAST_PIVOT:
                    factor[a, a] = np.sqrt(rest)
                else:
                    whole[i] = False
                    factor[a, a] = 1
        # The factor's inverse, turned over, and its product with itself.
        for b in range(p):
            turned[b, b] = 1 / factor[b, b]
            for a in range(b + 1, p):
                rest = 0.0
                for k in range(b, a):
                    rest -= factor[a, k] * turned[b, k]
                turned[b, a] = rest / factor[a, a]
        for a in range(p):
            for b in range(a + 1):
                rest = 0.0
                for k in range(a, p):
                    rest += turned[a, k] * turned[b, k]
                found[i, a, b] = found[i, b, a] = rest * scale[a] * scale[b]
    return found, whole
