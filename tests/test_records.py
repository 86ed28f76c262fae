"""`records.dataclass` makes of a class what the standard library makes of it."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import re
from collections.abc import Callable
from dataclasses import KW_ONLY, FrozenInstanceError, asdict, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import pytest

from suta_calib.records import dataclass

T = TypeVar("T")
Decorator = Callable[..., Any]


def plain(decorator: Decorator) -> type:
    @decorator
    class Plain:
        """No argument of the decorator."""

        a: int
        b: float = 3.0

    return Plain


def point(decorator: Decorator) -> type:
    @decorator(frozen=True)
    class Point(Generic[T]):
        """Every sort of field."""

        KIND: ClassVar[str] = "point"
        x: T
        y: float = 2.0
        tags: dict[str, int] = field(default_factory=dict, hash=False)
        hidden: int = field(default=5, repr=False, compare=False)
        _: KW_ONLY
        name: str
        unit: str = "mm"
        derived: float = field(init=False)
        fresh: list[int] = field(init=False, default_factory=list, compare=False)

        def __post_init__(self) -> None:
            object.__setattr__(self, "derived", self.y * 2.0)

    return Point


def derived(decorator: Decorator) -> type:
    @decorator(frozen=True)
    class Derived(point(decorator)):  # type: ignore[misc]
        """A default changed, a field added, and a method of its own."""

        y: float = 7.0
        extra: str = "e"

        def __repr__(self) -> str:
            return "its own"

    return Derived


def by_identity(decorator: Decorator) -> type:
    @decorator(frozen=True, eq=False, kw_only=True)
    class ByIdentity:
        """Neither positions nor comparison."""

        a: int
        b: int = 1

    return ByIdentity


def own_equality(decorator: Decorator) -> type:
    @decorator(frozen=True)
    class Own:  # noqa: PLW1641
        """What it has is left as it is; it is hashed by its fields all the same."""

        a: int
        b: int = 0

        def __eq__(self, other: object) -> bool:
            return isinstance(other, Own) and other.a == self.a

    return Own


CLASSES = (plain, point, derived, by_identity, own_equality)
CALLS: tuple[tuple[tuple[Any, ...], dict[str, Any]], ...] = (
    ((1,), {}),
    ((1, 2.5), {}),
    ((1,), {"name": "p"}),
    ((1, 2.5, {"t": 1}, 4), {"name": "p", "unit": "m"}),
    ((), {"x": 1, "name": "p", "y": 9.0}),
    ((), {"a": 1, "b": 2}),
    ((), {"a": 1}),
    ((1,), {"a": 1}),
    ((1,), {"unheard": 1, "name": "p"}),
    ((), {}),
    ((1, 2.0, {}, 4, "p", "mm", 7), {}),
    ((1,), {"name": "p", "derived": 3.0}),
)


def outcome(call: Callable[[], Any]) -> tuple[bool, Any]:
    """Whether it worked, and the object made."""
    try:
        return True, call()
    except TypeError:
        return False, None


@pytest.mark.parametrize("make", CLASSES)
@pytest.mark.parametrize("call", CALLS)
def test_objects_are_what_the_standard_library_makes(
    make: Callable[[Decorator], type], call: tuple[tuple[Any, ...], dict[str, Any]]
) -> None:
    args, given = call
    works, ours = outcome(lambda: make(dataclass)(*args, **given))
    as_well, theirs = outcome(lambda: make(dataclasses.dataclass)(*args, **given))
    assert works == as_well
    if works:
        assert asdict(ours) == asdict(theirs)
        assert [each.name for each in fields(ours)] == [each.name for each in fields(theirs)]
        if type(theirs).__repr__ is not object.__repr__:
            assert repr(ours) == repr(theirs)


@pytest.mark.parametrize("make", CLASSES)
def test_a_class_says_of_itself_what_it_would(make: Callable[[Decorator], Any]) -> None:
    ours, theirs = make(dataclass), make(dataclasses.dataclass)
    assert str(inspect.signature(ours)) == str(inspect.signature(theirs))
    assert ours.__match_args__ == theirs.__match_args__
    assert ours.__dataclass_params__.frozen == theirs.__dataclass_params__.frozen
    assert (ours.__hash__ is None) == (theirs.__hash__ is None)
    for name in ("__eq__", "__hash__", "__repr__"):
        inherited = getattr(theirs, name) is getattr(object, name)
        assert (getattr(ours, name) is getattr(object, name)) == inherited


@pytest.mark.parametrize("decorator", [dataclass, dataclasses.dataclass])
def test_equality_and_hash_are_those_of_the_fields(decorator: Decorator) -> None:
    Point, Derived = point(decorator), derived(decorator)
    one, same, other = Point(1, name="p"), Point(1, name="p", hidden=9), Point(2, name="p")
    assert one == same
    assert hash(one) == hash(same)
    assert one != other
    assert one != (1, 2.0)
    assert Derived(1, 2.0, name="p") != one
    Own = own_equality(decorator)
    assert Own(1, 2) == Own(1, 3)
    assert hash(Own(1, 2)) != hash(Own(1, 3))


def test_what_is_the_same_is_equal_as_in_a_tuple() -> None:
    Point, nan = point(dataclass), float("nan")
    assert Point(nan, name="p") == Point(nan, name="p")  # the standard library's until 3.12


@pytest.mark.parametrize("decorator", [dataclass, dataclasses.dataclass])
def test_a_frozen_object_stays_as_it_is(decorator: Decorator) -> None:
    for cls in (point(decorator), derived(decorator)):
        found = cls(1, name="p")
        with pytest.raises(FrozenInstanceError, match="cannot assign to field 'x'"):
            found.x = 2
        with pytest.raises(FrozenInstanceError, match="cannot assign to field 'anything'"):
            found.anything = 2
        with pytest.raises(FrozenInstanceError, match="cannot delete field 'x'"):
            del found.x

        class Open(cls):  # type: ignore[misc, valid-type]
            """What derives and is no data class may have attributes of its own."""

        opened = Open(1, name="p")
        opened.more = 3
        del opened.more
        with pytest.raises(FrozenInstanceError):
            opened.x = 2


def test_a_standard_data_class_may_derive_from_ours() -> None:
    @dataclasses.dataclass(frozen=True)
    class Standard(point(dataclass)):  # type: ignore[misc]
        more: int = 4

    found = replace(Standard(1, name="p"), more=6)
    assert (found.x, found.y, found.derived, found.more) == (1, 2.0, 4.0, 6)
    with pytest.raises(FrozenInstanceError):
        found.more = 1
    with pytest.raises(TypeError, match="non-frozen"):

        @dataclass
        class Loose(point(dataclass)):  # type: ignore[misc]
            more: int = 4


def test_what_derives_and_constructs_itself_says_what_it_takes() -> None:
    class Own(plain(dataclass)):  # type: ignore[misc]
        def __init__(self, unlike: str) -> None:
            super().__init__(len(unlike))

    class Same(plain(dataclass)):  # type: ignore[misc]
        pass

    assert list(inspect.signature(Own).parameters) == ["unlike"]
    assert list(inspect.signature(Same).parameters) == ["a", "b"]
    assert Own("four").a == 4


def test_wrong_arguments_are_named() -> None:
    Point = point(dataclass)
    with pytest.raises(TypeError, match="missing a required argument: 'x'"):
        Point(name="p")
    with pytest.raises(TypeError, match="multiple values for argument 'x'"):
        Point(1, x=2, name="p")
    with pytest.raises(TypeError, match="unexpected keyword argument 'z'"):
        Point(1, z=2, name="p")
    with pytest.raises(TypeError, match="too many positional"):
        Point(*range(9), name="p")


def test_what_it_cannot_make_is_refused() -> None:
    for option in ("slots", "order", "init"):
        with pytest.raises(TypeError, match=option):
            dataclass(frozen=True, **{option: True})  # type: ignore[call-overload]


@dataclass(frozen=True)
class Kept:
    """Of a module, as `pickle` wants it."""

    a: int
    b: list[Any] = field(default_factory=list)


def test_objects_are_copied_pickled_and_shown_within_themselves() -> None:
    found = Kept(1, [2])
    assert pickle.loads(pickle.dumps(found)) == copy.deepcopy(found) == found
    found.b.append(found)
    assert repr(found) == "Kept(a=1, b=[2, ...])"
    assert replace(Kept(1), a=5) == Kept(5)
    assert Kept(1).b is not Kept(1).b


def test_every_data_class_of_the_package_is_quick_to_define(repository: Path) -> None:
    standard = re.compile(r"^from dataclasses import .*\bdataclass\b", re.MULTILINE)
    texts = {
        file: file.read_text(encoding="utf-8")
        for file in (repository / "suta_calib").rglob("*.py")
        if file.name != "records.py"
    }
    # Slots come before a class is made: a module that wants them has the standard one.
    slow = [
        file for file, text in texts.items() if standard.search(text) and "slots=True" not in text
    ]
    assert not slow, "take `dataclass` from suta_calib.records, which is quicker to define"
    assert sum("from suta_calib.records import dataclass" in text for text in texts.values()) > 200
