"""What a foreign format says of itself, and how the formats of a package are found."""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from typing import ClassVar, TypeVar

from suta_calib.errors import InputError, did_you_mean
from suta_calib.exchange.option import Option


class Described:
    """A format that tells users what it is.

    Attributes:
        name: what ``--format`` calls it.
        summary: what it reads or writes, in a line.
        example: how it is used: what stands behind ``suta-calib import`` or ``export``.
        options: those it takes.
        extra: the optional extra of this package that it needs; empty for none.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    example: ClassVar[str]
    options: ClassVar[tuple[Option, ...]] = ()
    extra: ClassVar[str] = ""


Kind = TypeVar("Kind", bound=Described)


@cache
def formats_of(package: str, kind: type[Kind]) -> dict[str, Kind]:
    """The formats of a package by name: one of every class that its modules define.

    Args:
        package: full name of the package whose modules are looked through.
        kind: the abstract class that formats are of.
    """
    found: dict[str, Kind] = {}
    for module in pkgutil.iter_modules(import_module(package).__path__):
        for value in vars(import_module(f"{package}.{module.name}")).values():
            if not (isinstance(value, type) and issubclass(value, kind)):
                continue
            if not inspect.isabstract(value) and value.__module__ == f"{package}.{module.name}":
                found[value.name] = value()
    return dict(sorted(found.items()))


def named(formats: dict[str, Kind], name: str) -> Kind:
    """The format of a name.

    Raises:
        InputError: there is none; says which there are.
    """
    if name not in formats:
        known = ", ".join(formats)
        found = f"the format {name!r}"
        raise InputError(found, f"one of {known}", hint=did_you_mean(name, formats))
    return formats[name]


def options_of(formats: Iterable[Described]) -> list[Option]:
    """Every option of these formats, each once, in the order of the formats."""
    return list({option.name: option for each in formats for option in each.options}.values())
