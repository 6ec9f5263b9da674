"""What a fresh machine installs is what the figures were made with."""

import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from testfield.store.code import PACKAGES

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
WANTED = [Requirement(text) for text in [*PROJECT["dependencies"], *EXTRAS["dev"], *EXTRAS["peers"]]]
PINNED = {
    canonicalize_name(pin.name): next(iter(pin.specifier))
    for pin in map(Requirement, (ROOT / ".ci/constraints.txt").read_text().split())
}


def needed() -> set[str]:
    """All packages that installing with both extras brings, as far as they are installed here."""
    found: set[str] = set()
    waiting = [(requirement, "") for requirement in WANTED]
    while waiting:
        requirement, extra = waiting.pop()
        if requirement.marker and not requirement.marker.evaluate({"extra": extra}):
            continue
        name = canonicalize_name(requirement.name)
        if name in found:
            continue
        found.add(name)
        try:
            more = distribution(name).requires or []
        except PackageNotFoundError:
            continue
        waiting += [(Requirement(text), extra) for text in more for extra in (requirement.extras or {""})]
    return found


def test_every_package_is_pinned_to_one_version() -> None:
    assert needed() <= PINNED.keys()
    assert {pin.operator for pin in PINNED.values()} == {"=="}


def test_pins_lie_within_the_bounds() -> None:
    for requirement in WANTED:
        assert requirement.specifier.contains(PINNED[canonicalize_name(requirement.name)].version), requirement.name


def test_packages_that_decide_figures_are_bounded_above() -> None:
    bounded = {canonicalize_name(r.name) for r in WANTED if any(s.operator == "<" for s in r.specifier)}
    assert {canonicalize_name(name) for name in PACKAGES} <= bounded
