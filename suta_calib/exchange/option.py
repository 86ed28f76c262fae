"""Options that a format declares, what the user gave for them, and what a format says of itself."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from suta_calib.errors import InputError, did_you_mean
from suta_calib.measurements.csv_table import number_in
from suta_calib.measurements.yaml_file import YamlSection, read_yaml
from suta_calib.registry import Group, all_classes


@dataclass(frozen=True)
class Option:
    """One option of a format; those that several formats share are one object.

    Attributes:
        name: in Python and in a file of options; ``--name`` on the command line.
        help: what it does, in a line.
        metavar: what its value looks like.
        choices: the values there are; any text where none are listed.
        several: whether it may be given several times; then its value is a tuple.
        flag: whether it has no value and is given or not.
        file: whether its value names a file that is read.
    """

    name: str
    help: str
    metavar: str = "TEXT"
    choices: tuple[str, ...] = ()
    several: bool = False
    flag: bool = False
    file: bool = False

    @property
    def switch(self) -> str:
        """As it stands on the command line."""
        return "--" + self.name.replace("_", "-")


class Given:
    """What was given for the options of one format: checked names, values as text.

    Args:
        known: the options that the format takes.
        values: by name; None and empty tuples count as not given.
        who: the format, for messages.

    Raises:
        InputError: an option that the format does not take, or a value that is no choice.
    """

    def __init__(self, options: Iterable[Option], values: Mapping[str, Any], who: str) -> None:
        self._known = {option.name: option for option in options}
        self._values: dict[str, tuple[str, ...]] = {}
        self._guesses: list[str] = []
        for name, value in values.items():
            if value is None or value is False or value == ():
                continue
            if name not in self._known:
                takes = ", ".join(option.switch for option in self._known.values())
                problem = f"the option {name.replace('_', '-')!r} for the format {who}"
                expected = f"one of {takes}" if takes else "no options"
                hint = did_you_mean(name, self._known)
                raise InputError(problem, expected, hint=hint)
            listed = value if isinstance(value, list | tuple) else (value,)
            self._values[name] = tuple(str(text) for text in listed)
            self._check(self._known[name])

    def _check(self, option: Option) -> None:
        for value in self._values[option.name] if option.choices else ():
            if value not in option.choices:
                raise self.refuse(option, repr(value), f"one of {', '.join(option.choices)}")

    def note_guess(self, option: Option, value: str, why: str) -> None:
        """Remember what was guessed for an option, and what left it open."""
        self._guesses.append(f"Guessed: {option.switch} {value}. The file has {why}.")

    @property
    def guesses(self) -> tuple[str, ...]:
        """What was guessed while a file was read, one sentence each."""
        return tuple(dict.fromkeys(self._guesses))

    def __contains__(self, option: Option) -> bool:
        return option.name in self._values

    def text(self, option: Option, default: str = "") -> str:
        """The value, or the last of several; the default where it was not given."""
        return self._values.get(option.name, (default,))[-1]

    def texts(self, option: Option) -> tuple[str, ...]:
        """Every value that was given; parts between commas are values of their own."""
        values = self._values.get(option.name, ())
        return tuple(part.strip() for value in values for part in value.split(",") if part.strip())

    def path(self, option: Option) -> Path | None:
        """The value as a file's name."""
        return Path(self.text(option)) if option in self else None

    def pairs(self, option: Option) -> dict[str, str]:
        """``a=b,c=d`` as a mapping."""
        return self._pairs(option, self.texts(option))

    def _pairs(self, option: Option, parts: Iterable[str]) -> dict[str, str]:
        pairs: dict[str, str] = {}
        for part in parts:
            name, equals, value = (text.strip() for text in part.partition("="))
            if not (name and equals and value):
                raise self.refuse(option, repr(part), f"parts such as {option.metavar}")
            if name in pairs:
                raise self.refuse(option, f"{name!r} twice", "each name only once")
            pairs[name] = value
        return pairs

    def numbers(self, option: Option) -> dict[str, float]:
        """``a=1,b=2`` as numbers by name; a number alone, by no name, is that of all others."""
        parts = self.texts(option)
        alone = [part for part in parts if math.isfinite(number_in(part))]
        named = self._pairs(option, (part for part in parts if part not in alone))
        if len(alone) > 1:
            raise self.refuse(option, " and ".join(alone), "one number for all names")
        numbers = {name: number_in(value) for name, value in named.items()}
        if alone:
            numbers[""] = number_in(alone[0])
        largest = 1e12
        for name, number in numbers.items():
            if not abs(number) < largest:
                raise self.refuse(option, f"no number for {name!r}", "a finite number")
        return numbers

    def whole(self, option: Option, default: str, least: int, most: int, expected: str) -> int:
        """The value as a whole number within bounds."""
        text = self.text(option, default)
        # Not one of thousands of digits.
        if text.isascii() and text.isdigit() and len(text) <= 12 and least <= int(text) <= most:
            return int(text)
        raise self.refuse(option, repr(text), expected)

    @staticmethod
    def refuse(option: Option, problem: str, expected: str, hint: str = "") -> InputError:
        """Error about an option, to be raised by the caller."""
        return InputError(problem, expected, where=option.switch, hint=hint)


def options_from_file(path: Path) -> dict[str, Any]:
    """A YAML file of options by name: what one would otherwise give on the command line.

    A value may be a text, a number, a list of them, or, for options such as ``columns``, a
    mapping.
    """
    top = YamlSection(read_yaml(path), InputError)
    options: dict[str, Any] = {}
    for key, value in top.data.items():
        items = value if isinstance(value, list) else [value]
        if isinstance(value, dict):
            items = list(value.values())
        if any(isinstance(item, dict | list) or item is None for item in items):
            raise top.refuse("a nested value", "a text, a number or a list of them", at=(key,))
        texts = [("yes" if item else "no") if isinstance(item, bool) else item for item in items]
        if isinstance(value, dict):
            texts = [f"{name}={item}" for name, item in zip(value, texts, strict=True)]
        options[key.replace("-", "_")] = texts if isinstance(value, dict | list) else texts[0]
    return options


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
    """The formats of a package of ours, and of other packages' entry points, by name."""
    classes = all_classes(group, base, package)
    return {name: form() for name, form in sorted(classes.items())}


def named(formats: dict[str, Kind], name: str) -> Kind:
    """The format of a name."""
    if name not in formats:
        names = ", ".join(formats)
        problem = f"the format {name!r}"
        raise InputError(problem, f"one of {names}", hint=did_you_mean(name, formats))
    return formats[name]


def options_of(formats: Iterable[Described]) -> list[Option]:
    """Every option of these formats, each once, in the order of the formats."""
    return list({option.name: option for form in formats for option in form.options}.values())
