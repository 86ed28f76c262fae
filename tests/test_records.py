"""Dataclasses that are made without compiling are those of the standard library."""

from __future__ import annotations

import ast
import copy
import dataclasses
import inspect
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import KW_ONLY, FrozenInstanceError, asdict, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from suta_calib import records

# What people derive from by the standard library's own; what has slots.
BY_THE_STANDARD_LIBRARY = {"terms/term.py", "measurements/board.py", "device/reading.py"}
Decorator = Callable[..., Any]


def family(dataclass: Decorator) -> dict[str, type]:
    """The same classes, by either decorator: defaults, places, names, inheritance, own methods."""

    @dataclass(frozen=True)
    class Point:
        """Of three fields."""

        x: float
        y: float = 2.0
        tags: list[str] = field(default_factory=list, compare=False)
        dimensions: ClassVar[int] = 2

    @dataclass(frozen=True)
    class Named(Point):
        """More fields, one of them by name alone, one hidden."""

        _: KW_ONLY
        name: str
        secret: str = field(default="s", repr=False)

    @dataclass(frozen=True, eq=False, kw_only=True)
    class Told:
        """By name alone; one field it makes itself."""

        a: int
        b: int = 3
        total: int = field(init=False)

        def __post_init__(self) -> None:
            object.__setattr__(self, "total", self.a + self.b)

    @dataclass(frozen=True)
    class Own:  # noqa: PLW1641 - the decorator writes the hash
        """Shows and compares itself in its own way."""

        a: int

        def __repr__(self) -> str:
            return "own"

        def __eq__(self, other: object) -> bool:
            return isinstance(other, Own) and (self.a - other.a) % 10 == 0

    @dataclass(frozen=True)
    class Hashed(Own):
        """With a hash of its own, and no field more."""

        def __hash__(self) -> int:
            return 7

    @dataclass(frozen=True)
    class Nothing:
        """No fields."""

    found = {"Point": Point, "Named": Named, "Told": Told, "Own": Own, "Hashed": Hashed}
    return found | {"Nothing": Nothing}


OURS, THEIRS = family(records.dataclass), family(dataclasses.dataclass)
CALLS: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = [
    ("Point", (1.0,), {}),
    ("Point", (1.0, 5.0, ["t"]), {}),
    ("Point", (), {"y": 3.0, "x": 1.0}),
    ("Point", (), {}),
    ("Point", (1.0,), {"x": 2.0}),
    ("Point", (1.0, 2.0, [], 4.0), {}),
    ("Point", (1.0,), {"z": 2.0}),
    ("Named", (1.0,), {"name": "n"}),
    ("Named", (1.0, 2.0, ["t"]), {"name": "n", "secret": "t"}),
    ("Named", (1.0, 2.0, ["t"], "n"), {}),
    ("Named", (1.0,), {}),
    ("Told", (), {"a": 1}),
    ("Told", (1,), {}),
    ("Told", (), {"a": 1, "total": 4}),
    ("Own", (1,), {}),
    ("Hashed", (1,), {}),
    ("Nothing", (), {}),
    ("Nothing", (1,), {}),
]


def made(cls: type, values: tuple[Any, ...], named: dict[str, Any]) -> Any:
    try:
        return cls(*values, **named)
    except TypeError:
        return None


@pytest.mark.parametrize(("name", "values", "named"), CALLS)
def test_an_object_is_as_the_standard_library_makes_it(
    name: str, values: tuple[Any, ...], named: dict[str, Any]
) -> None:
    ours, theirs = (made(classes[name], values, named) for classes in (OURS, THEIRS))
    assert (ours is None) == (theirs is None)
    if ours is None:
        return
    assert repr(ours) == repr(theirs)
    assert asdict(ours) == asdict(theirs)
    again, other = made(OURS[name], values, named), made(THEIRS[name], values, named)
    assert (ours == again) == (theirs == other)
    assert (ours == 3) == (theirs == 3)
    for each in (copy.copy(ours), copy.deepcopy(ours)):
        assert type(each) is OURS[name]
        assert vars(each) == vars(ours)
    for change in ("x", "a", "made up"):
        for change_it in (lambda o, c: setattr(o, c, 1), delattr):
            for each in (ours, theirs):
                with pytest.raises(FrozenInstanceError):
                    change_it(each, change)


@pytest.mark.parametrize("name", OURS)
def test_a_class_says_of_itself_what_the_standard_library_says(name: str) -> None:
    ours, theirs = OURS[name], THEIRS[name]
    assert dataclasses.is_dataclass(ours)
    seen = [
        [(f.name, f.init, f.repr, f.compare, f.kw_only) for f in fields(c)] for c in (ours, theirs)
    ]
    assert seen[0] == seen[1]
    assert ours.__match_args__ == theirs.__match_args__
    assert str(inspect.signature(ours)) == str(inspect.signature(theirs))
    assert (ours.__hash__ is None) == (theirs.__hash__ is None)


def test_hashes_go_by_what_is_compared() -> None:
    point, named = OURS["Point"], OURS["Named"]
    assert hash(point(1.0, 2.0, ["a"])) == hash(point(1.0, 2.0, ["b"]))
    assert len({point(1.0), point(1.0), point(2.0)}) == 2
    assert point(1.0) != named(1.0, name="n")
    assert hash(OURS["Hashed"](3)) == 7


@given(st.floats(), st.floats(), st.lists(st.text(max_size=3), max_size=2))
def test_replaced_and_compared_as_by_the_standard_library(
    x: float, y: float, tags: list[str]
) -> None:
    (mine, changed), (theirs, other) = (
        (p, replace(p, y=y, tags=tags)) for p in (c["Point"](x) for c in (OURS, THEIRS))
    )
    assert repr(changed) == repr(other)
    assert (mine == changed) == (theirs == other)
    assert (hash(mine) == hash(changed)) == (hash(theirs) == hash(other))


@records.dataclass(frozen=True)
class Kept:
    """What can be pickled is at the top of a module."""

    inner: Any = None


def test_pickled_and_shown_within_itself() -> None:
    assert pickle.loads(pickle.dumps(Kept(Kept(3)))) == Kept(Kept(3))
    loop: list[Any] = []
    loop.append(Kept(loop))
    assert repr(loop[0]) == "Kept(inner=[...])"


def test_either_derives_from_what_the_standard_library_made() -> None:
    @dataclasses.dataclass(frozen=True)
    class Base:
        """What others derive from."""

        a: int

    @records.dataclass(frozen=True)
    class Ours(Base):
        """One of the package's."""

        b: int = 2

    @dataclasses.dataclass(frozen=True)
    class Theirs(Ours):
        """Somebody's own."""

        c: int = 3

    assert asdict(Theirs(1)) == {"a": 1, "b": 2, "c": 3}
    for each in (Ours(1), Theirs(1)):
        with pytest.raises(FrozenInstanceError):
            each.a = 2  # type: ignore[misc]


def test_what_is_not_frozen_or_has_slots_is_the_standard_librarys() -> None:
    @records.dataclass(eq=False)
    class Loose:
        """May change."""

        a: int

    @records.dataclass(frozen=True, slots=True)
    class Slim:
        """Has slots."""

        a: int

    loose = Loose(1)
    loose.a = 2
    assert loose.a == 2
    assert not hasattr(Slim(1), "__dict__")


def test_nothing_is_compiled() -> None:
    """Text that Python compiles, for both decorators; from 3.13 on an empty frame is."""
    code = """
import dataclasses, sys
from suta_calib import records
compiled = []
sys.addaudithook(lambda event, a: compiled.append(len(a[0])) if event == 'compile' else None)
for dataclass in (records.dataclass, dataclasses.dataclass):
    compiled.clear()
    made = dataclass(frozen=True)(type('C', (), {'__doc__': 'c', '__annotations__': {'a': int}}))
    assert made(1) == made(1), made(1)
    print(sum(compiled))
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    ours, theirs = map(int, run.stdout.split())
    assert ours < theirs / 4
    assert sys.version_info >= (3, 13) or ours == 0


def test_the_package_declares_its_frozen_dataclasses_so(repository: Path) -> None:
    package, found = repository / "suta_calib", set()
    for file in package.rglob("*.py"):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        compiled = any(
            isinstance(node, ast.ImportFrom)
            and node.module == "dataclasses"
            and "dataclass" in {alias.name for alias in node.names}
            for node in ast.walk(tree)
        )
        frozen = any(
            keyword.arg == "frozen" and ast.unparse(keyword.value) == "True"
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "dataclass"
            for keyword in node.keywords
        )
        found |= {file.relative_to(package).as_posix()} if compiled and frozen else set()
    assert found == BY_THE_STANDARD_LIBRARY
