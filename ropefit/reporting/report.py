"""The self-contained HTML report: one page that opens offline and asks the network for nothing."""

from __future__ import annotations

from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from ropefit import __version__
from ropefit.reporting.contents import RunContents
from ropefit.reporting.sections import SECTIONS
from ropefit.reporting.words import slug

__all__ = ["RunContents", "render_report"]


def render_report(run: RunContents) -> str:
    """The whole page. The same artifacts give the same bytes."""
    here = files("ropefit.reporting")
    template = Environment(
        loader=PackageLoader("ropefit.reporting", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template("page.html.j2")
    sections = [
        {"id": slug(section.title), "title": section.title, "body": Markup(section.render(run))}
        for section in SECTIONS
        if section.applies(run)
    ]
    return template.render(
        recording=run.observations.recording,
        version=__version__,
        sections=sections,
        style=Markup((here / "page.css").read_text(encoding="utf-8")),
        script=Markup((here / "page.js").read_text(encoding="utf-8")),
        plotly=Markup(get_plotlyjs().replace("</script", "<\\/script")),
    )
