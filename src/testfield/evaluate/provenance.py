"""Where a comparison's figures come from: digests, seeds, versions, processor, and the command that repeats it."""

import os
import platform
import shlex
from collections.abc import Sequence
from pathlib import Path

from testfield.evaluate.case import Case
from testfield.evaluate.comparison import Comparison
from testfield.evaluate.keys import case_key
from testfield.score.floor import renderer_digest
from testfield.store.code import PACKAGES, package_version
from testfield.store.digests import digest, file_digest
from testfield.version import __version__

SHOWN = 16
"""Characters of a digest that a page shows."""


def provenance(comparison: Comparison, cases: Sequence[Case], command: Sequence[str]) -> dict[str, str]:
    """By name, in the order in which a page shows it."""
    scenes = {str(scene): file_digest(scene)[:SHOWN] for scene in comparison.scenes}
    recipes = {recipe.name: digest(recipe)[:SHOWN] for recipe in comparison.recipes}
    factors = [f"{factor.field} = {', '.join(map(str, factor.values))}" for factor in comparison.factors]
    seeds = f"noise seeds 1 to {comparison.draws} in every scene, whose own seed makes its world"
    packages = ", ".join(f"{name} {package_version(name)}" for name in PACKAGES)
    return {
        "command that repeats it": shlex.join(["testfield", *command]),
        "scenes (SHA-256 of the files)": "; ".join(f"{name} {code}" for name, code in scenes.items()),
        "recipes (digests)": "; ".join(f"{name} {code}" for name, code in recipes.items()),
        **({"factors": "; ".join(factors)} if factors else {}),
        "seeds": seeds,
        "all cases, data and code (digest)": digest(sorted(case_key(case) for case in cases))[:SHOWN],
        "renderer and sensor (digest)": renderer_digest()[:SHOWN],
        "versions": f"testfield {__version__}, Python {platform.python_version()}, {packages}",
        "processor": f"{processor()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}",
    }


def processor() -> str:
    """What the processor calls itself."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8", "replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
