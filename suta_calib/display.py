"""Objects that show themselves: a few lines on a console, tables in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any, Final

# Knows the tables. It is named, not imported: what shows itself is what it is made of.
_TABLES: Final = "suta_calib.report.notebook"
# Characters of one value.
_LONGEST_VALUE: Final = 60
# Entries of a sequence that are worth listing, and numbers of an array.
_FEW: Final = 4


def named(module: str, name: str) -> Any:
    """Something of a module that stands in a row below, and is therefore named, not imported.

    What shows or judges an answer is made of the answer. An answer that shows or judges itself
    says who does it, by this alone.

    Args:
        module: its full name.
        name: of the thing in it.
    """
    return getattr(import_module(module), name)


class Displayable:
    """Has a short `repr`, and tables where a notebook shows it.

    A subclass may say in `in_a_line` what it is; of others a few of their attributes are shown, in
    place of the whole content that a dataclass would print.
    """

    __slots__ = ()

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        # A dataclass writes none where the class has one.
        if "__repr__" not in vars(cls):
            cls.__repr__ = _shown  # type: ignore[method-assign, assignment]

    @property
    def in_a_line(self) -> str:
        """What it is, in a few words: no arrays."""
        if not is_dataclass(self):
            shown = {name: value for name, value in vars(self).items() if name[0] != "_"}
        else:
            # What is as it is by default is not worth a word.
            values = {f.name: (getattr(self, f.name), f.default) for f in fields(self) if f.repr}
            empty = (Mapping, tuple, list)
            shown = {
                name: value
                for name, (value, usual) in values.items()
                if value is not usual and not (isinstance(value, empty) and not value)
            }
        return "".join(_at_most(f"{name}={_brief(value)}" for name, value in shown.items()))

    def _repr_html_(self) -> str:
        """What Jupyter shows: the tables of the report, without its pictures."""
        html: str = named(_TABLES, "html_of")(self)
        return html


def _shown(self: Displayable) -> str:
    return f"<{type(self).__name__}: {self.in_a_line}>"


def _at_most(parts: Iterable[str]) -> Iterator[str]:
    """The first parts of a text, some six lines of a console, with commas between them."""
    length = 0
    for part in parts:
        text = f", {part}" if length else part
        if (length := length + len(text)) > 500:
            yield ", …"
            return
        yield text


def _brief(value: Any) -> str:
    """A value in a few words: how large an array or a sequence is, not what it holds."""
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and shape:
        few = getattr(value, "size", 0) <= _FEW and len(shape) == 1
        return _listed(value.tolist()) if few else f"{' × '.join(map(str, shape))} numbers"
    if isinstance(value, Mapping | list | tuple | set | frozenset):
        return _listed(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    text = "" if isinstance(value, Displayable) or is_dataclass(value) else repr(value)
    if not 0 < len(text) <= _LONGEST_VALUE or "\n" in text:
        return f"{text[:_LONGEST_VALUE]}…'" if isinstance(value, str) else type(value).__name__
    return text


def _listed(values: Any) -> str:
    """A few entries, or how many there are."""
    count = len(values)
    pairs = values.items() if isinstance(values, Mapping) else None
    if count <= _FEW:
        entries = (
            [_brief(value) for value in values]
            if pairs is None
            else [f"{key}: {_brief(value)}" for key, value in pairs]
        )
        text = ", ".join(entries)
        if len(text) <= _LONGEST_VALUE:
            return f"[{text}]"
    kinds = {type(value).__name__ for value in (values if pairs is None else values.values())}
    return f"{count} {kinds.pop() if len(kinds) == 1 else 'entries'}"
