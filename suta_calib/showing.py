"""Objects that show themselves: a line on a console, tables in a notebook."""

from __future__ import annotations

from abc import abstractmethod
from importlib import import_module
from typing import Final

# Knows the tables. It is named, not imported: what shows itself is what it is made of.
_TABLES: Final = "suta_calib.report.notebook"


class Shown:
    """Has a short `repr`, and tables where a notebook shows it.

    A subclass says in `in_a_line` what it is; a dataclass must be declared with ``repr=False``.
    """

    __slots__ = ()

    @property
    @abstractmethod
    def in_a_line(self) -> str:
        """What it is, in a few words: no arrays."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.in_a_line}>"

    def _repr_html_(self) -> str:
        """What Jupyter shows: the tables of the report, without its pictures."""
        html: str = import_module(_TABLES).html_of(self)
        return html
