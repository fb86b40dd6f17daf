"""A table of numbers in text, below a header of a few rows: found here, read by pandas."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from ropefit.errors import BadInput

LOOKED_AT = 41  # rows, among which a header ends
SAMPLE = 4096  # characters, whose first line tells the delimiter
ENCODING = "utf-8-sig"


@dataclass(frozen=True)
class Table:
    """The first rows of a file that are not empty, their cells without spaces around them; `line`
    counts all rows of the file from 0."""

    source: Path
    delimiter: str
    rows: list[list[str]]
    line: list[int]

    @classmethod
    def of(cls, source: Path) -> Table:
        """Return the beginning of a file. Raises BadInput where it has fewer than two rows."""
        with source.open(newline="", encoding=ENCODING) as file:
            first = (file.read(SAMPLE).splitlines() or [""])[0]
            delimiter = max(",;\t", key=first.count)
            file.seek(0)
            every = islice(csv.reader(file, delimiter=delimiter), 2 * LOOKED_AT)
            found = [(n, [cell.strip() for cell in row]) for n, row in enumerate(every)]
        found = [(n, row) for n, row in found if any(row)][:LOOKED_AT]
        if len(found) < 2:
            raise BadInput(f"{source}: has no rows")
        return cls(source, delimiter, [row for _, row in found], [n for n, _ in found])

    def numbers(self, header: int, width: int) -> np.ndarray:
        """Return (F, width) numbers below so many rows of header; NaN for what is empty or missing.

        Raises BadInput where a cell is no number, a row is too long, or there is none.
        """
        import pandas  # most commands need none

        widest = max([width, *map(len, self.rows[header:])])
        how = {
            "sep": self.delimiter, "header": None, "names": range(widest), "index_col": False,
            "skiprows": self.line[header - 1] + 1 if header else 0, "encoding": ENCODING,
        }  # fmt: skip
        try:
            table = pandas.read_csv(
                self.source, dtype=float, skipinitialspace=True, **how
            ).to_numpy()
        except pandas.errors.EmptyDataError:
            table = np.zeros((0, widest))
        except ValueError as error:
            raise BadInput(f"{self.source}: {self._wrong(pandas, how, header) or error}")
        written = np.isfinite(table)
        if written[:, width:].any():
            raise BadInput(f"{self.source}: a row has {widest} cells, its header {width}")
        last = np.flatnonzero(written.any(axis=1))
        if not last.size:
            raise BadInput(f"{self.source}: a header, but no numbers below it")
        return table[: last[-1] + 1, :width]

    def _wrong(self, pandas, how: dict, header: int) -> str | None:
        """Return where the first cell is that is no number; None where the rows are no table."""
        try:
            text = pandas.read_csv(self.source, dtype=str, **how)
        except ValueError:
            return None
        for name, column in text.items():
            number = pandas.to_numeric(column, errors="coerce")
            bad = np.flatnonzero(number.isna() & column.notna())
            if bad.size:
                head = self.rows[header - 1] if header else []
                named = head[name] if name < len(head) and head[name] else str(name + 1)
                return (
                    f"row {bad[0] + 1} below the header, column {named}: "
                    f"{column.iloc[bad[0]][:40]!r} is not a number"
                )
        return None
