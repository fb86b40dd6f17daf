"""Pieces of the page in HTML. Everything that is not Markup is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup

from ropefit.reporting.figures import Figure

WIDE = 4  # columns that a phone still shows side by side


def paragraph(text: object, kind: str = "") -> Markup:
    """Return a paragraph, of a CSS class."""
    return Markup('<p class="{}">{}</p>' if kind else "<p>{1}</p>").format(kind, text)


def loose(text: object) -> Markup:
    """Return text that may be broken anywhere: long names without spaces."""
    return Markup('<span class="loose">{}</span>').format(text)


def heading(text: object) -> Markup:
    """Return a heading inside a section."""
    return Markup("<h3>{}</h3>").format(text)


def facts(items: Mapping[Any, object]) -> Markup:
    """Return names and values, side by side."""
    rows = Markup("").join(
        Markup("<div><dt>{}</dt><dd>{}</dd></div>").format(name, value)
        for name, value in items.items()
    )
    return Markup('<dl class="facts">{}</dl>').format(rows)


def bullets(items: Iterable[object]) -> Markup:
    """Return an unordered list."""
    rows = Markup("").join(Markup("<li>{}</li>").format(item) for item in items)
    return Markup("<ul>{}</ul>").format(rows) if rows else rows


def table(
    head: Sequence[str], rows: Iterable[Sequence[object]], numeric: Sequence[int] = ()
) -> Markup:
    """Return a table; a wide one becomes cards on a phone. `numeric`: columns set to the right."""
    kinds = [Markup(' class="number"') if i in numeric else "" for i in range(len(head))]
    top = Markup("").join(
        Markup('<th scope="col"{}>{}</th>').format(kind, name)
        for kind, name in zip(kinds, head, strict=True)
    )
    body = Markup("").join(
        Markup("<tr>{}</tr>\n").format(
            Markup("").join(
                Markup('<td data-label="{}"{}>{}</td>').format(name, kind, cell)
                for name, kind, cell in zip(head, kinds, row, strict=True)
            )
        )
        for row in rows
    )
    return Markup('<table class="{}"><thead><tr>{}</tr></thead><tbody>\n{}</tbody></table>').format(
        "stack" if len(head) > WIDE else "", top, body
    )


_kept: ContextVar[list[Figure] | None] = ContextVar("kept", default=None)


@contextmanager
def keeping() -> Iterator[list[Figure]]:
    """Return every figure that is put on a page meanwhile, in order."""
    figures: list[Figure] = []
    token = _kept.set(figures)
    try:
        yield figures
    finally:
        _kept.reset(token)


def plot(figure: Figure) -> Markup:
    """Return a figure with its caption; drawn when the page is opened."""
    if (kept := _kept.get()) is not None:
        kept.append(figure)
    content = figure.content() | {"height": figure.height}
    return Markup(
        '<figure class="plot"><div class="canvas" aria-label="{}"></div>'
        '<script type="application/json">{}</script><figcaption>{}</figcaption></figure>\n'
    ).format(figure.name, htmlsafe_json_dumps(content), figure.caption)


def pair(*figures: Figure) -> Markup:
    """Place figures beside each other, below each other where the page is narrow."""
    return Markup('<div class="pair">{}</div>').format(Markup("").join(map(plot, figures)))


def sequence(
    figures: Sequence[Figure], labels: Sequence[str], start: int = 0, main: bool = False
) -> Markup:
    """Return figures that show one step of many, moved together by a slider.

    main: the page's one picture, which the maps move.
    """
    slider = Markup("")
    if len(labels) > 1:
        slider = Markup(
            '<button type="button">Play</button>'
            '<input type="range" min="0" max="{}" value="{}" aria-label="Frame">'
            "<output>{}</output>"
        ).format(len(labels) - 1, start, labels[start])
    for figure in figures:
        if figure.enlarged:
            slider += Markup(
                '<label><input type="checkbox"> difference of the models × {}</label>'
            ).format(figure.enlarged[2])
    return Markup(
        '<div class="sequence{}" data-start="{}">{}<div class="control">{}</div>'
        '<script type="application/json" class="labels">{}</script></div>'
    ).format(
        " main" if main else "", start, pair(*figures), slider, htmlsafe_json_dumps(list(labels))
    )
