"""Whether an algorithm takes what the pipeline gives it: asked before anything is rendered."""

from collections.abc import Mapping
from inspect import Parameter, signature
from math import isfinite
from pathlib import Path
from typing import Any

from testfield.errors import TestfieldError, nearest
from testfield.registry import KINDS, find

GIVEN = {
    "detectors": ("frame", "field"),
    "finders": ("image_dn", "sheet", "smallest_px", "largest_px"),
    "centroids": ("image_dn", "sheet", "xy_px", "moments_px2"),
    "decoders": ("image_dn", "xy_px", "moments_px2", "contrast_dn", "background_dn", "bits", "radii"),
    "calibrators": ("observations", "field", "width_px", "height_px"),
    "reconstructors": ("observations", "calibration", "field"),
}
"""What the pipeline gives by position; everything else that an algorithm takes is an option."""
ALWAYS = {"calibrators": ("lens", "hold")}
"""Options that every recipe gives."""
INTERNAL = ("cameras", "misfit")
"""Arguments that only the pipeline gives."""


def options_of(stage: str, name: str) -> list[str] | None:
    """Names of the options that an algorithm takes; None for one that takes any."""
    taken = signature(find(stage, name)).parameters.values()
    if any(one.kind is Parameter.VAR_KEYWORD for one in taken):
        return None
    return [one.name for one in list(taken)[len(GIVEN[stage]) :] if one.name not in INTERNAL]


def check_signature(stage: str, name: str, options: Mapping[str, Any], where: str) -> None:
    """Raise `TestfieldError` where an algorithm does not take what it will be given, or asks for what it is not."""
    known = options_of(stage, name)
    for option in options:
        if known is not None and option not in known:
            do = nearest(option, known) if known else "it takes none"
            raise TestfieldError(f"'{name}' takes no option '{option}'", f"{where}.{option}", do)
    given, found = GIVEN[stage], signature(find(stage, name))
    for option, value in options.items():
        if option in found.parameters and (wanted := _not_like(value, found.parameters[option].default)):
            said = str(value)[:60]
            raise TestfieldError(f"value {said!r}: {wanted} is wanted", f"{where}.{option}", "as its default is")
    place = f"{_file_of(find(stage, name))}, {find(stage, name).__qualname__}{found}"
    contract = f"{KINDS[stage]}s are given {', '.join(given)}" + "".join(f", {name}=" for name in ALWAYS.get(stage, ()))
    by_position = [
        one.name
        for one in found.parameters.values()
        if one.kind in (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    ]
    for k, (own, wanted) in enumerate(zip(by_position, given, strict=False)):
        if own != wanted and own in given:
            raise TestfieldError(
                f"'{name}' takes '{own}' where it is given '{wanted}', as argument {k + 1} of {len(given)}",
                place,
                contract,
            )
    try:
        found.bind(*given, **dict.fromkeys((*ALWAYS.get(stage, ()), *options)))
    except TypeError as error:
        raise TestfieldError(f"'{name}' cannot be called ({error})", place, contract) from error


def _not_like(value: Any, default: Any) -> str:
    """What is wanted in the place of a value that is of another kind than an option's default; "" where it is of that
    kind, or where the default does not tell."""
    if isinstance(default, bool):
        return "" if isinstance(value, bool) else "true or false"
    if isinstance(default, (int, float)):
        number = isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)
        return "" if number else "a finite number"
    if isinstance(default, str):
        return "" if isinstance(value, str) else "a text"
    if isinstance(default, (tuple, list)):
        return "" if isinstance(value, (tuple, list)) else "a list"
    return ""


def _file_of(function: Any) -> str:
    """The file of a loaded function, or the module of one in a package."""
    code = getattr(function, "__code__", None)
    return str(function.__module__) if code is None or "." in function.__module__ else Path(code.co_filename).name
