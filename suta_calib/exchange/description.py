"""What a foreign format says of itself, and how the formats of a package are found."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import ClassVar, TypeVar

from suta_calib.errors import InputError, did_you_mean
from suta_calib.exchange.option import Option
from suta_calib.registry import Group, all_classes


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
def formats_of(group: Group, package: str, base: type[Kind]) -> dict[str, Kind]:
    """The formats of a package of ours, and of other packages' entry points, by name.

    Args:
        group: of the entry points.
        package: full name of the package whose modules are looked through.
        base: the abstract class that formats are of.
    """
    classes = all_classes(group, base, package)
    return {name: form() for name, form in sorted(classes.items())}


def named(formats: dict[str, Kind], name: str) -> Kind:
    """The format of a name.

    Raises:
        InputError: there is none; says which there are.
    """
    if name not in formats:
        names = ", ".join(formats)
        problem = f"the format {name!r}"
        raise InputError(problem, f"one of {names}", hint=did_you_mean(name, formats))
    return formats[name]


def options_of(formats: Iterable[Described]) -> list[Option]:
    """Every option of these formats, each once, in the order of the formats."""
    return list({option.name: option for form in formats for option in form.options}.values())
