"""The self-contained HTML report: one page that opens offline and asks the network for nothing."""

from __future__ import annotations

from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from ropefit import __version__
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import Figure
from ropefit.reporting.html import keeping
from ropefit.reporting.sections import SECTIONS
from ropefit.reporting.words import slug

__all__ = ["RunContents", "figures_of", "render_page", "render_report"]


def render_report(run: RunContents) -> str:
    """The whole page. The same artifacts give the same bytes."""
    parts = [(section.title, section.render(run)) for section in SECTIONS if section.applies(run)]
    return render_page(run.observations.recording, parts)


def figures_of(run: RunContents) -> list[Figure]:
    """Every figure of the report, in its order."""
    with keeping() as figures:
        for section in SECTIONS:
            if section.applies(run):
                section.render(run)
    return figures


def render_page(title: str, parts: list[tuple[str, Markup]]) -> str:
    """A page of sections (title, body)."""
    here = files("ropefit.reporting")
    template = Environment(
        loader=PackageLoader("ropefit.reporting", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template("page.html.j2")
    return template.render(
        title=title,
        version=__version__,
        sections=[{"id": slug(name), "title": name, "body": Markup(body)} for name, body in parts],
        style=Markup((here / "page.css").read_text(encoding="utf-8")),
        script=Markup((here / "page.js").read_text(encoding="utf-8")),
        plotly=Markup(get_plotlyjs().replace("</script", "<\\/script")),
    )
