"""Unknowns that the observations hardly determine, by name."""

import numpy as np

WEAK = 1e-6
"""Eigenvalue of the reduced normal matrix at unit diagonal below which a combination of unknowns is hardly known: its
uncertainty is a thousand times what it would be if all others were known."""
NAMED = 0.25
"""Share of a weak combination from which an unknown is named."""


def weak_unknowns(covariance: np.ndarray, labels: list[str]) -> list[str]:
    """Sentences on weak combinations in a covariance (P, P) of the unknowns `labels`, weakest first."""
    normal = np.linalg.inv(covariance)
    scale = 1 / np.sqrt(np.diag(normal))
    values, vectors = np.linalg.eigh(normal * scale[:, None] * scale)
    notes = []
    for k in np.flatnonzero(values < WEAK):
        share = np.abs(vectors[:, k])
        named = [labels[i] for i in np.argsort(-share)[:6] if share[i] > NAMED * share.max()]
        # Below this an eigenvalue is rounding.
        least = len(values) * np.finfo(float).eps
        factor = f"{1 / np.sqrt(values[k]):.2g}" if values[k] > least else f"more than {1 / np.sqrt(least):.0g}"
        notes.append(f"hardly determined together: {', '.join(named)} ({factor} times less than each alone)")
    return notes
