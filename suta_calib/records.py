"""Frozen dataclasses that are made without compiling anything.

`dataclasses.dataclass` writes up to six methods of each class as text and has Python compile them.
It takes a quarter of a millisecond, and a command makes a hundred classes before it does anything:
a tenth of what a person waits for. Here the fields are the standard library's, and the methods are
functions that look at them. What the standard library says of a frozen dataclass holds (`replace`,
`fields`, `asdict`, ``__match_args__``, inheritance, copies), and type checkers see its own.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import MISSING, FrozenInstanceError, fields
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any, Final, NoReturn, TypeVar

C = TypeVar("C", bound=type)
Methods = dict[str, Callable[..., Any]]


def _dataclass(
    *,
    frozen: bool = False,
    slots: bool = False,
    eq: bool = True,
    repr: bool = True,
    kw_only: bool = False,
) -> Callable[[C], C]:
    """As `dataclasses.dataclass`, which makes what is not frozen or has slots.

    What people derive their own classes from (`terms.Term`) is declared by that one itself: it
    takes nothing frozen that inherits only from what it does not know to be.
    """
    if slots or not frozen:
        theirs: Callable[[Any], Any] = dataclasses.dataclass(
            frozen=frozen, slots=slots, eq=eq, repr=repr, kw_only=kw_only
        )
        return theirs

    def made(cls: C) -> C:
        own = dict(vars(cls))
        above = (getattr(base, "__dataclass_params__", None) for base in cls.__mro__[1:])
        known = any(params is not None and params.frozen for params in above)
        dataclasses.dataclass(init=False, repr=False, eq=False, frozen=known, kw_only=kw_only)(cls)
        methods: Methods = {"__init__": _initialiser(cls)}
        if not known:
            methods |= {"__setattr__": _refuse, "__delattr__": _refuse}
        if repr:
            methods["__repr__"] = _shown
        if eq:
            methods |= _comparison(cls)
        for name, method in methods.items():
            # None is what Python itself writes for the hash of what compares in its own way.
            if own.get(name) is None:
                setattr(cls, name, method)
        cls.__signature__ = _SIGNATURE  # type: ignore[attr-defined]
        return cls

    return made


if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:
    dataclass = _dataclass


def _initialiser(cls: type) -> Callable[..., None]:
    """``__init__`` of a class: by place, by name, by default, and then ``__post_init__``."""
    given = [f for f in fields(cls) if f.init]
    places = [f.name for f in given if not f.kw_only]
    names = {f.name for f in given}
    defaults = {f.name: f.default for f in given if f.default is not MISSING}
    factories = {f.name: f.default_factory for f in fields(cls) if f.default_factory is not MISSING}
    most, whole = len(places), len(names | factories.keys())
    has_more = hasattr(cls, "__post_init__")

    def initialise(self: Any, /, *values: object, **named: object) -> None:
        # Not by attributes, which are frozen.
        own = vars(self)
        if len(values) > most:
            found = f"takes {most} positional arguments, and {len(values)} were given"
            raise TypeError(f"{cls.__qualname__}() {found}")
        own.update(zip(places, values, strict=False))
        if named:
            if wrong := (named.keys() - names) | (named.keys() & own.keys()):
                found = f"got unexpected or repeated arguments: {', '.join(sorted(wrong))}"
                raise TypeError(f"{cls.__qualname__}() {found}")
            own.update(named)
        if len(own) < whole:
            own.update((name, value) for name, value in defaults.items() if name not in own)
            own.update((name, make()) for name, make in factories.items() if name not in own)
            if missing := names - own.keys():
                found = f"misses arguments: {', '.join(sorted(missing))}"
                raise TypeError(f"{cls.__qualname__}() {found}")
        if has_more:
            self.__post_init__()

    return initialise


def _comparison(cls: type) -> Methods:
    """``__eq__`` and ``__hash__`` of a class, by the fields that are compared."""
    names = [f.name for f in fields(cls) if f.compare]
    compared: Callable[[object], object] = attrgetter(*names) if names else lambda _: ()

    def equal(self: object, other: object) -> object:
        if other.__class__ is not self.__class__:
            return NotImplemented
        return compared(self) == compared(other)

    def hashed(self: object) -> int:
        return hash(compared(self))

    return {"__eq__": equal, "__hash__": hashed}


@recursive_repr()
def _shown(self: Any) -> str:
    values = ", ".join(f"{f.name}={getattr(self, f.name)!r}" for f in fields(self) if f.repr)
    return f"{type(self).__qualname__}({values})"


def _refuse(self: object, name: str, *_: object) -> NoReturn:
    raise FrozenInstanceError(f"cannot assign to or delete field {name!r} of {type(self).__name__}")


class _Factory:
    """Stands in a signature for a default that is made anew each time."""

    def __repr__(self) -> str:
        return "<factory>"


class _Signature:
    """The signature of a class, which is seldom asked for, and takes long to make."""

    def __get__(self, instance: object, cls: Any) -> Any:
        from inspect import Parameter, Signature

        if instance is not None:
            raise AttributeError("__signature__")
        ways = Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY
        parameters = []
        for f in sorted((f for f in fields(cls) if f.init), key=lambda f: bool(f.kw_only)):
            default = Parameter.empty if f.default is MISSING else f.default
            default = default if f.default_factory is MISSING else _Factory()
            parameters.append(
                Parameter(f.name, ways[bool(f.kw_only)], default=default, annotation=f.type)
            )
        return Signature(parameters, return_annotation=None)


_SIGNATURE: Final = _Signature()
