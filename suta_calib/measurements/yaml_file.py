"""YAML files: plain data that remembers the line of every key, and checked access to it.

`yaml_nodes` reads the text. What every reader of a file then needs is a value of the right type, or
one error that names the file, the line and the key. Keys are written as a path:
``observations[0].huber_mm``.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, cast

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import InputError, SamplesError, did_you_mean
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.measurements.files import expand, read_text
from suta_calib.measurements.yaml_nodes import plain_data
from suta_calib.units import FARTHEST, from_deg, from_mm, mm

KeyPath = tuple[str | int, ...]
Sign = Literal["any", "non-negative", "positive"]
# Every whole number up to it is a float too.
LARGEST_WHOLE: Final = 1 << 53


@dataclass(frozen=True)
class YamlDocument(Displayable):
    """A YAML file as plain data, with the line every key came from.

    Attributes:
        path: the file.
        data: dict, list, str, int, float, bool and None; keys are the text in the file.
        lines: line number, from 1, of every key or list index.
    """

    path: Path
    data: dict[str, Any]
    lines: Mapping[KeyPath, int]

    def line_of(self, *keys: str | int) -> int | None:
        """Line of a key, or of the nearest key around it that is in the file."""
        while keys and keys not in self.lines:
            keys = keys[:-1]
        return self.lines.get(keys)


def read_yaml(path: str | Path, error: type[InputError] = InputError) -> YamlDocument:
    """Read a YAML file whose top level is a mapping.

    Raises:
        InputError: (as ``error``) unreadable, empty, not YAML, a key twice, a reference to
            itself, more than any file of this field says, or another top level; with the line
            where there is one.
    """
    path = Path(path)
    data, lines = plain_data(path, read_text(path, error), error)
    return YamlDocument(path, data, lines)


@dataclass(frozen=True)
class YamlSection(Displayable):
    """A mapping inside a document.

    Attributes:
        document: the file it is in.
        error: the class of the errors raised about it.
        path: keys and list indices that lead to it; empty for the whole file.
    """

    document: YamlDocument
    error: type[InputError]
    path: KeyPath = ()

    @property
    def data(self) -> dict[str, Any]:
        """The mapping itself."""
        value: Any = self.document.data
        for key in self.path:
            value = value[key]
        return cast(dict[str, Any], value)

    @property
    def line(self) -> int | None:
        """Line where it begins, from 1."""
        return self.document.line_of(*self.path)

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def refuse(
        self, problem: str, expected: str = "", *, at: KeyPath = (), hint: str = ""
    ) -> InputError:
        """Error about the value at ``at`` below this mapping, to be raised by the caller."""
        keys, file = (*self.path, *at), self.document.path
        line, where = self.document.line_of(*keys), _written(keys)
        return self.error(problem, expected, file=file, line=line, where=where, hint=hint)

    def check_keys(self, allowed: Collection[str], required: Collection[str] = ()) -> None:
        """Refuse keys that are not known, and the absence of required ones."""
        for key in self.data:
            if key not in allowed:
                raise self.refuse(
                    "an unknown key", ", ".join(allowed), at=(key,), hint=did_you_mean(key, allowed)
                )
        for key in required:
            self._value(key)

    def section(self, *at: str | int) -> YamlSection:
        """The mapping under a key, or under a path of keys and indices; must not be empty."""
        value: Any = self.data
        for key in at:
            value = self._present(value, key, at)
        if not isinstance(value, dict) or not value:
            raise self.refuse(shown(value), "a mapping of keys to values", at=at)
        return YamlSection(self.document, self.error, (*self.path, *at))

    def sections(self, key: str, least: int = 1) -> list[YamlSection]:
        """The mappings in the list under a key, ``least`` (0 or 1) at least."""
        value = self._value(key)
        if not isinstance(value, list) or len(value) < least:
            expected = "a list with at least one row" if least else "a list of rows, or []"
            raise self.refuse(shown(value), expected, at=(key,))
        return [self.section(key, index) for index in range(len(value))]

    def text(self, key: str, default: str | None = None) -> str:
        """A word or sentence that is not empty; ``default`` where the key is absent."""
        value = self._value(key) if default is None else self.data.get(key, default)
        return self._text(value, (key,))

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of words, at least one; a single word counts as a list of one."""
        value = self._value(key)
        if not isinstance(value, list):
            return (self._text(value, (key,)),)
        if not value:
            raise self.refuse("an empty list", "at least one entry", at=(key,))
        return tuple(self._text(item, (key, index)) for index, item in enumerate(value))

    def choice(self, key: str, options: Collection[str], default: str | None = None) -> str:
        """One of a few words."""
        value = self.text(key, default)
        if value not in options:
            hint = did_you_mean(value, options)
            raise self.refuse(repr(value), f"one of {', '.join(options)}", at=(key,), hint=hint)
        return value

    def number(self, key: str, sign: Sign = "any") -> float:
        """A finite number."""
        return self._number(self._value(key), (key,), sign)

    def numbers(self, key: str, count: int) -> list[float]:
        """A list of ``count`` finite numbers."""
        value = self._value(key)
        if not isinstance(value, list) or len(value) != count:
            problem = f"{len(value)} values" if isinstance(value, list) else shown(value)
            raise self.refuse(problem, f"a list of {count} numbers", at=(key,))
        return [self._number(item, (key, index), "any") for index, item in enumerate(value)]

    def integer(self, key: str, minimum: int, maximum: int = LARGEST_WHOLE) -> int:
        """A whole number from ``minimum`` to ``maximum``.

        A number that nobody means is refused at once: a thousand million starts, or samples, would
        be computed for days.
        """
        value = self._value(key)
        is_integer = isinstance(value, int) and not isinstance(value, bool)
        if not is_integer or not minimum <= value <= maximum:
            up = f"to {maximum:,}"
            if maximum == LARGEST_WHOLE:
                up = "up" if not is_integer or value < minimum else "to 2^53"
            raise self.refuse(shown(value), f"a whole number from {minimum} {up}", at=(key,))
        return int(value)

    def bits(self, key: str, minimum: int) -> int:
        """Of an encoder."""
        value = self.integer(key, minimum)
        if value > 52:
            raise self.refuse(str(value), "at most 52 bits", at=(key,))
        return value

    def position(self, key: str) -> FloatArray:
        """Three numbers in mm as (3,), m."""
        position = from_mm(np.array(self.numbers(key, 3)))
        for index in np.flatnonzero(np.abs(position) > FARTHEST):
            value = self.data[key][index]
            expected = f"a position within {mm(FARTHEST):g} mm"
            raise self.refuse(shown(value), expected, at=(key, int(index)))
        return position

    def rotation(self, key: str) -> FloatArray:
        """Roll, pitch and yaw in degrees, as in a URDF, as a matrix (3, 3)."""
        return rotation_from_rpy(from_deg(np.array(self.numbers(key, 3))))

    def flag(self, key: str) -> bool:
        """True or false; false where the key is absent."""
        value = self.data.get(key, False)
        if not isinstance(value, bool):
            raise self.refuse(shown(value), "true or false", at=(key,))
        return value

    def existing_file(self, key: str) -> Path:
        """A file that exists, named relative to the document's folder."""
        file = self.document.path.parent / self.text(key)
        try:
            exists = file.is_file()
        except OSError:
            exists = False
        if not exists:
            raise self.refuse(f"no file {file}", "a file that exists", at=(key,))
        return file

    def files(self, key: str) -> tuple[Path, ...]:
        """Files that match a glob or a list of globs, at least one of each.

        Patterns are relative to the document's folder. A file counts once, by whichever of its
        paths comes first: ``a.csv`` and ``../job/a.csv`` may be one.
        """
        files: dict[Path, Path] = {}
        for pattern in self.texts(key):
            try:
                for file in expand(pattern, self.document.path.parent):
                    files.setdefault(file.resolve(), file)
            except SamplesError as problem:
                raise self.refuse(
                    problem.found, problem.expected, at=(key,), hint=problem.hint
                ) from None
        return tuple(files.values())

    def _value(self, key: str) -> Any:
        return self._present(self.data, key, (key,))

    def _present(self, mapping: Any, key: str | int, at: KeyPath) -> Any:
        if isinstance(key, str) and key not in mapping:
            raise self.refuse("no such key", "a value: this key is required", at=at)
        return mapping[key]

    def _text(self, value: Any, at: KeyPath) -> str:
        if not isinstance(value, str) or not value.strip():
            hint = "put it in quotes" if isinstance(value, (bool, int, float)) else ""
            raise self.refuse(shown(value), "text", at=at, hint=hint)
        return value.strip()

    def _number(self, value: Any, at: KeyPath, sign: Sign) -> float:
        # No length, angle or count of this field is larger; its square would soon be infinite. Nor
        # is any size (a noise level, a bound, a prior: what is divided by) smaller, a picometre in
        # mm, but zero.
        largest = 1e12
        smallest = 1e-9
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.refuse(shown(value), "a number", at=at)
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.refuse(shown(value), "a finite number", at=at)
        if abs(number) > largest:
            raise self.refuse(shown(value), f"a number of at most {largest:g}", at=at)
        if (number < 0 and sign != "any") or (number == 0 and sign == "positive"):
            raise self.refuse(shown(value), f"a {sign} number", at=at)
        if sign != "any" and 0 < number < smallest:
            least = (
                f"at least {smallest:g}" if sign == "positive" else f"0, or {smallest:g} or more"
            )
            raise self.refuse(shown(value), least, at=at)
        return number


def shown(value: Any) -> str:
    """A value as an error message calls it, on one line and not too long."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, dict)):
        return f"{'a' if value else 'an empty'} {'list' if isinstance(value, list) else 'mapping'}"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]}…"


def _written(keys: KeyPath) -> str:
    """``observations[0].huber_mm`` for the keys that lead there."""
    parts = (
        f"[{key}]" if isinstance(key, int) else "." + (key if key.isprintable() else repr(key))
        for key in keys
    )
    return "".join(parts).lstrip(".")
