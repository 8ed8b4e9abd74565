"""What every report is made of: figures inline, one template, one style."""

import base64
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from rig.compare.style import Plot


@dataclass(frozen=True)
class Figure:
    """A figure with its heading and caption."""

    title: str
    plot: Plot
    caption: str

    @property
    def uri(self) -> str:
        """For the src of an img."""
        return "data:image/svg+xml;base64," + base64.b64encode(self.plot.svg.encode()).decode()


def render(template: str, **about: Any) -> str:
    """A self-contained page from a template of this package."""
    environment = Environment(
        loader=PackageLoader("rig.compare"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**about)
