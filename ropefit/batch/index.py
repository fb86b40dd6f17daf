"""What came of a batch: its summary, summary.csv, and a page that links the reports."""

from __future__ import annotations

import csv
import io
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from ropefit import __version__
from ropefit.batch.records import Batch, Record, write_text

HEAD = (
    "recording", "state", "frames", "length [m]", "noise [mm]", "parameters", "rms fit [mm]",
    "held out [mm]", "left out", "time [s]", "remark",
)  # fmt: skip
NUMERIC = (2, 3, 4, 6, 7, 9)
BRIEF = (0, 1, 2, 6, 8, 9)  # what a terminal has room for


def summary(batch: Batch) -> dict[str, Any]:
    """Return what `--json` says of a batch."""
    return {
        "stage": "batch",
        "runs": str(batch.runs),
        "index": str(batch.runs / "index.html"),
        "summary": str(batch.runs / "summary.csv"),
        **batch.counts(),
        "recordings": [
            {
                "name": r.name,
                "recording": r.recording,
                "run": str(batch.runs / r.name),
                "state": r.state,
                "stage": r.stage,
                "message": r.message,
                "exit_code": r.exit_code,
                "attempts": r.attempts,
                "seconds": r.seconds,
                "bytes": r.sizes,
                "peak_memory_bytes": r.peak,
                "results": r.results,
            }
            for r in batch.records
        ],
    }


def write_index(runs: Path, records: list[Record]) -> None:
    """Write summary.csv and index.html. Raises StageFailed."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(HEAD)
    table.writerows([[_no_formula(cell) for cell in cells(r)] for r in records])
    write_text(runs / "summary.csv", text.getvalue())
    write_text(runs / "index.html", _page(runs, records))


def cells(r: Record) -> list[str]:
    """Return the cells of a recording, in the order of HEAD."""
    found = r.results
    parameters = [
        f"{name} {p['value']:.4g} {'' if p['unit'] == '1' else p['unit']} ({p['verdict']})"
        for name, p in found.get("parameters", {}).items()
    ]
    verdict = found.get("verdict", "")
    left_out = ", ".join(found.get("effects", [])) or verdict
    remarks = [r.message] if r.message else []
    remarks += [f"{item} not converged" for item in found.get("unconverged", [])]
    remarks += [f"{found['dropped']} frames dropped"] if found.get("dropped") else []
    return [
        r.name,
        r.state if r.state != "failed" else f"failed in {r.stage}",
        str(found.get("frames", "")),
        _number(found.get("length_m")),
        _number(found.get("noise_m"), 1e3),
        "; ".join(parameters),
        _number(found.get("rms_fit_m"), 1e3),
        _number(found.get("rms_heldout_m"), 1e3),
        left_out,
        f"{sum(r.seconds.values()):.1f}" if r.seconds else "",
        "; ".join(remarks),
    ]


def _number(value: float | None, factor: float = 1.0) -> str:
    return "" if value is None else f"{factor * value:.3g}"


def _no_formula(cell: str) -> str:
    """Return a cell that no spreadsheet takes for a formula: names come from other people's
    folders."""
    return f"'{cell}" if cell[:1] in ("=", "+", "@", "\t") else cell


def _page(runs: Path, records: list[Record]) -> str:
    from ropefit.reporting.html import facts, table

    style = Markup((files("ropefit.reporting") / "page.css").read_text(encoding="utf-8"))
    order = {"failed": 0, "running": 1, "busy": 2, "done": 3}
    rows = []
    for record in sorted(records, key=lambda r: order[r.state]):
        row: list[object] = list(cells(record))
        if "report.html" in record.sizes:
            link = Markup('<a href="{}">{}</a>')
            row[0] = link.format(quote(f"{record.name}/report.html"), record.name)
        rows.append(row)
    seconds = sum(sum(r.seconds.values()) for r in records)
    held = sum(sum(r.sizes.values()) for r in records)
    head = facts(
        {
            "recordings": len(records),
            **{s: n for s in order if (n := sum(r.state == s for r in records))},
            "computing time": f"{seconds / 3600:.2f} h",
            "size of the runs": f"{held / 1e6:.1f} MB",
            "most memory of a process": f"{max((r.peak for r in records), default=0) / 1e6:.0f} MB",
        }
    )
    return Markup(
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "style-src 'unsafe-inline'\"><title>{title} – ropefit</title><style>{style}\n"
        "body {{ max-width: 100rem; }}</style></head><body><header>"
        '<p class="brand">ropefit batch</p><h1>{title}</h1></header><main>{head}{table}</main>'
        "<footer><p>Written by ropefit {version}.</p></footer></body></html>\n"
    ).format(
        title=runs.resolve().name,
        style=style,
        head=head,
        table=table(HEAD, rows, NUMERIC),
        version=__version__,
    )
