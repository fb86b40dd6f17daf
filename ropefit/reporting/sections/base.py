"""What every section of the report is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from markupsafe import Markup

from ropefit.reporting.contents import RunContents


class Section(ABC):
    """One part of the page. A new one is a file with a subclass and its line in SECTIONS."""

    title: ClassVar[str]
    folded: ClassVar[bool] = False  # below the answer and its reasons, opened by a click

    def applies(self, run: RunContents) -> bool:
        """Return whether the run has what this section shows."""
        return True

    @abstractmethod
    def render(self, run: RunContents) -> Markup:
        """Return the section's HTML under its heading; escapes everything it did not write
        itself."""
