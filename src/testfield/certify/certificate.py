"""The certificate: all verdicts, as JSON, as a page and as a table."""

import json
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from testfield.certify.verdict import Verdict
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.score.floor import renderer_digest
from testfield.store.code import PACKAGES, package_version
from testfield.store.stamp import stamp
from testfield.store.text import read_text, write_text
from testfield.version import __version__

PARTS = ("geometry", "light", "lens", "focus", "sensor", "sameness")


def certify(scene: Path, quick: bool, tell: Callable[[Verdict], None]) -> dict[str, Any]:
    """Measure every part; `tell` hears each verdict as it falls. Returns the certificate."""
    verdicts: list[Verdict] = []
    seconds = {}
    for part in PARTS:
        start = time.perf_counter()
        for verdict in _measure(part, scene, quick):
            verdicts.append(verdict)
            tell(verdict)
        seconds[part] = round(time.perf_counter() - start, 1)
    return stamp() | {
        "quick": quick,
        "passed": all(verdict.passed for verdict in verdicts),
        "verdicts": [_plain(verdict) for verdict in verdicts],
        "code": renderer_digest(),
        "versions": {"testfield": __version__, "python": platform.python_version()}
        | {name: package_version(name) for name in PACKAGES},
        "time_s": seconds,
    }


def _plain(verdict: Verdict) -> dict[str, Any]:
    numbers = {"measured": float(verdict.measured), "limit": float(verdict.limit), "passed": verdict.passed}
    return vars(verdict) | numbers


def _measure(part: str, scene: Path, quick: bool) -> list[Verdict]:
    if part == "geometry":
        from testfield.certify.geometry import certify_geometry

        return certify_geometry(quick)
    if part == "light":
        from testfield.certify.light import certify_light

        return certify_light(build_world(load_scene(scene)), quick)
    if part == "lens":
        from testfield.certify.lens import certify_lens

        return certify_lens(quick)
    if part == "focus":
        from testfield.certify.focus import certify_focus

        return certify_focus(quick)
    if part == "sensor":
        from testfield.certify.sensor import certify_sensor

        return certify_sensor(quick)
    from testfield.certify.sameness import certify_sameness

    return certify_sameness(scene, quick)


def write_certificate(certificate: dict[str, Any], folder: Path) -> None:
    """Write `certificate.json` and `certificate.html`."""
    from jinja2 import Environment, StrictUndefined

    from testfield.store.atomic import whole

    with whole(folder / "certificate.json") as path:
        write_text(path, json.dumps(certificate, indent=1))
    environment = Environment(undefined=StrictUndefined, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    template = read_text(Path(__file__).with_name("certificate.html"))
    with whole(folder / "certificate.html") as path:
        write_text(path, environment.from_string(template).render(c=certificate))
