"""How every page is made: one folder of templates, one style, nothing undefined."""

from pathlib import Path
from typing import Any

FILTERS = {
    "num": lambda v, form: "–" if v is None or v != v else form % v,
    "mm": lambda v: "–" if v is None else f"{v:.4f}",
    "signed": lambda v: "–" if v is None else f"{v:+.4f}",
    "short": lambda v: "–" if v is None else f"{v:.3g}",
    "cell": lambda v: "–" if v is None or v != v else f"{v:.4g}" if isinstance(v, float) else str(v),
}


def page(template: str, **values: Any) -> str:
    """A page from the template of that name in this folder."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(FILTERS)
    return environment.get_template(template).render(**values)
