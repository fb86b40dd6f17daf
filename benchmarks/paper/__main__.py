"""One experiment of the paper: recordings, runs, tables and figures.

    python -m benchmarks.paper pipelines/baxter.toml [--write docs/paper.md] [--tables] [--only RUN]

Recordings and runs go to build/paper; --tables writes the document from what is there already,
--only does some of the runs again.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.document import parser, publish
from benchmarks.paper import baxter, dvrk, shape_control
from benchmarks.paper.pipeline import read
from benchmarks.paper.results import Results
from benchmarks.paper.runner import Place, perform, recall

SECTIONS = {
    "baxter": baxter.section,
    "dvrk": dvrk.section,
    "shape-control": shape_control.section,
}


def main() -> None:
    """Run the command line."""
    arguments = parser(__doc__)
    arguments.add_argument("pipeline", type=Path, help="pipelines/*.toml")
    arguments.add_argument("--build", type=Path, default=Path("build/paper"))
    arguments.add_argument("--figures", type=Path, default=Path("docs/figures"))
    arguments.add_argument("--tables", action="store_true", help="run nothing, only write")
    arguments.add_argument("--only", action="append", help="do this run again; repeatable")
    options = arguments.parse_args()
    experiment = read(options.pipeline)
    place = Place(options.build / experiment.experiment)
    if not options.tables:
        perform(experiment, place, set(options.only or ()))
    said = recall(experiment, place)
    results = Results(experiment, place, said, options.figures)
    text = SECTIONS[experiment.experiment](results)
    publish(options, experiment.experiment, text, said)


if __name__ == "__main__":
    main()
