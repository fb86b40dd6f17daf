"""Which stage made what from what, so that every number can be made again."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from ropefit.artifacts import Artifact, content_sha256
from ropefit.reporting.contents import RunContents
from ropefit.reporting.html import table
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import number

SHORT = 10  # digits of a hash that are shown


class ProvenanceSection(Section):
    """The flow of artifacts, and a row a stage."""

    title = "Provenance"
    folded = True

    def render(self, run: RunContents) -> Markup:
        made = (run.observations, run.model, run.diagnosis, run.control, run.exports)
        artifacts = [a for a in made if a is not None]
        head = ["stage", "read", "wrote", "settings", "version", "took", "created"]
        return _flow(artifacts) + table(head, [_row(a) for a in artifacts])


def _flow(artifacts: Sequence[Artifact]) -> Markup:
    chain: list[tuple[str, str]] = [("file", "recording")]
    for artifact in artifacts:
        chain += [("stage", artifact.provenance.stage), ("file", artifact.file_name)]
    chain += [("stage", "report"), ("file", "report.html")]
    steps = Markup("").join(
        Markup('<li><span class="{}">{}</span></li>').format(*step) for step in chain
    )
    return Markup('<ol class="flow">{}</ol>').format(steps)


def _row(artifact: Artifact) -> list[object]:
    p = artifact.provenance
    read = [_hashed(name, digest) for name, digest in p.inputs.items()]
    settings = ", ".join(f"{key} = {_value(value)}" for key, value in p.settings.items())
    return [
        p.stage,
        Markup("<br>").join(read),
        _hashed(artifact.file_name, content_sha256(artifact)),
        Markup("{} {}").format(
            settings, Markup("<code>{}</code>").format(p.settings_sha256[:SHORT])
        ),
        p.package_version,
        f"{number(p.seconds, 2)}\N{NO-BREAK SPACE}s",
        p.created.replace("T", " ").replace("+00:00", " UTC"),
    ]


def _hashed(name: str, digest: str) -> Markup:
    return Markup('{} <code class="stamp">{}</code>').format(name, digest[:SHORT])


def _value(value: object) -> str:
    if value is None or value in ({}, []):
        return "default"
    return str(value)
