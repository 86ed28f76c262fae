"""Objects that show themselves: a line on a console, tables in a notebook."""

from __future__ import annotations

from abc import abstractmethod
from importlib import import_module
from typing import Any, Final

# Knows the tables. It is named, not imported: what shows itself is what it is made of.
_TABLES: Final = "suta_calib.report.notebook"


def named(module: str, name: str) -> Any:
    """Something of a module that stands in a row below, and is therefore named, not imported.

    What shows or judges an answer is made of the answer. An answer that shows or judges itself
    says who does it, by this alone.

    Args:
        module: its full name.
        name: of the thing in it.
    """
    return getattr(import_module(module), name)


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
        html: str = named(_TABLES, "html_of")(self)
        return html
