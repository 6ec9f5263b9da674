"""Whether errors are as large as was claimed: bands for normalised estimation errors squared (METHODS section 5.4)."""

from scipy.stats import binom, chi2


def nees_band(freedom: int, p: float = 0.95) -> tuple[float, float]:
    """Within which NEES per degree of freedom lies with probability p, where all claims are true; `freedom` counts the
    degrees of all independent parts together. Points that share a calibration are one part."""
    return float(chi2.ppf(0.5 - p / 2, freedom) / freedom), float(chi2.ppf(0.5 + p / 2, freedom) / freedom)


def hit_band(trials: int, p: float, central: float = 0.99) -> tuple[int, int]:
    """Numbers of hits that `trials` independent events of probability p give with probability `central` or more,
    as much being cut off below as above: 931 to 967 of 1000 at 95 % (METHODS section 5.4)."""
    return int(binom.ppf(0.5 - central / 2, trials, p)), int(binom.ppf(0.5 + central / 2, trials, p))
