"""The self-contained HTML report: one page that opens offline and asks the network for nothing."""

from __future__ import annotations

from importlib.resources import files
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ropefit import __version__
from ropefit.reporting.answer import headline
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import Figure
from ropefit.reporting.html import keeping
from ropefit.reporting.sections import SECTIONS
from ropefit.reporting.words import slug

__all__ = ["RunContents", "figures_of", "render_page", "render_report"]


class Part(NamedTuple):
    """A section of a page; folded: only its title is seen at first."""

    title: str
    body: Markup
    folded: bool = False


def render_report(run: RunContents) -> str:
    """Return the whole page. The same artifacts give the same bytes."""
    return render_page(run.observations.recording, _parts(run), headline(run))


def figures_of(run: RunContents) -> list[Figure]:
    """Return every figure of the report, in its order."""
    with keeping() as figures:
        _parts(run)
    return figures


def _parts(run: RunContents) -> list[Part]:
    return [Part(s.title, s.render(run), s.folded) for s in SECTIONS if s.applies(run)]


def render_page(title: str, parts: list[Part], headline: str = "") -> str:
    """Return a page of sections; headline: the answer that stands above them instead of the
    title."""
    here = files("ropefit.reporting")

    def text(name: str) -> Markup:
        return Markup((here / name).read_text(encoding="utf-8"))

    template = Environment(
        loader=PackageLoader("ropefit.reporting", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template("page.html.j2")
    return template.render(
        title=title,
        headline=headline,
        version=__version__,
        sections=[{"id": slug(p.title) or "rope", **p._asdict()} for p in parts],
        style=text("page.css"),
        figures=text("figures.js"),
        script=text("page.js"),
    )
