"""Data classes that are quick to define: those of the standard library, with methods shared.

`dataclasses.dataclass` writes the methods of every class as text and compiles it, up to six texts
each: with the hundred and more classes of a command, a sixth of its time. Here the standard library
finds a class's fields, so that `fields`, `replace` and `asdict` know it and a data class of its own
may derive from it, and the methods are functions over those fields. An object takes a microsecond
longer to make for it: what is made for every reading of an encoder is left to the standard library.
"""

from __future__ import annotations

from dataclasses import MISSING, FrozenInstanceError, fields, is_dataclass
from dataclasses import dataclass as standard
from inspect import Parameter, Signature
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    # To type checkers it is the same thing.
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls=None, /, *, repr=True, eq=True, frozen=False, kw_only=False):
        """`dataclasses.dataclass`, quicker to define; without `InitVar`, order and slots.

        Args:
            cls: the class, where the decorator has no arguments.
            repr: whether it gets a ``__repr__``.
            eq: whether it gets an ``__eq__`` and, where it is frozen, a ``__hash__``.
            frozen: whether its attributes cannot be set.
            kw_only: whether its fields are given by name alone.
        """

        def made(cls):
            own = {name for name, value in vars(cls).items() if value is not None}
            # The standard library insists that what derives from a frozen class is frozen.
            derived = any(map(is_dataclass, cls.__bases__))
            by_it = {"frozen": frozen and derived, "kw_only": kw_only}
            standard(init=False, repr=False, eq=False, **by_it)(cls)
            told = cls.__dataclass_params__
            told.init, told.repr, told.eq, told.frozen = True, repr, eq, frozen
            methods = _construction(cls)
            if repr:
                methods["__repr__"] = _repr
            if eq:
                methods |= _comparisons(cls, frozen)
            if frozen and not derived:
                methods |= _guards(cls)
            for name in methods.keys() - own:
                setattr(cls, name, methods[name])
            return cls

        return made if cls is None else made(cls)


def _construction(cls: type) -> dict[str, Any]:
    """``__init__``, and ``__signature__``, by which others see what it takes."""
    taken = [field for field in fields(cls) if field.init]
    names = [field.name for field in taken if not field.kw_only]
    # In the order of the fields, as the standard library sets them.
    defaults, count = {field.name: field.default for field in taken}, len(taken)
    # What stands for a default: it makes one, or says that there is none.
    otherwise = [(field.name, field.default_factory) for field in taken if field.default is MISSING]
    fresh = [
        (field.name, field.default_factory)
        for field in fields(cls)
        if not field.init and field.default_factory is not MISSING
    ]
    goes_on = hasattr(cls, "__post_init__")

    def init(self: Any, /, *args: Any, **given: Any) -> None:
        values = defaults | given
        values.update(zip(names, args, strict=False))
        twice = given and not given.keys().isdisjoint(names[: len(args)])
        if twice or len(values) > count or len(args) > len(names):
            _refuse(cls, args, given)
        for name, factory in otherwise:
            if values[name] is MISSING:
                if factory is MISSING:
                    _refuse(cls, args, given)
                values[name] = factory()
        for name, factory in fresh:
            values[name] = factory()
        vars(self).update(values)
        if goes_on:
            self.__post_init__()

    return {"__init__": init, "__signature__": _Taken(init)}


class _Taken:
    """The arguments of a data class, found when they are asked for."""

    def __init__(self, init: Any) -> None:
        self._init = init

    def __get__(self, instance: object, owner: Any) -> Signature:
        if owner.__init__ is not self._init:
            raise AttributeError(f"{owner.__qualname__} has another __init__")
        return _signature(owner)


def _signature(cls: Any) -> Signature:
    taken = []
    for field in sorted((f for f in fields(cls) if f.init), key=attrgetter("kw_only")):
        kind = Parameter.KEYWORD_ONLY if field.kw_only else Parameter.POSITIONAL_OR_KEYWORD
        default: object = Parameter.empty if field.default is MISSING else field.default
        if field.default_factory is not MISSING:
            default = _FACTORY
        taken.append(Parameter(field.name, kind, default=default, annotation=field.type))
    return Signature(taken, return_annotation=None)


def _refuse(cls: type, args: tuple[Any, ...], given: dict[str, Any]) -> NoReturn:
    """Say in Python's words what is wrong with the arguments."""
    try:
        _signature(cls).bind(*args, **given)
    except TypeError as error:
        raise TypeError(f"{cls.__qualname__}.__init__() {error}") from None
    raise AssertionError(given)


class _Factory:
    """Stands in a signature for what is made anew for every object."""

    def __repr__(self) -> str:
        return "<factory>"


_FACTORY = _Factory()


@recursive_repr()
def _repr(self: Any) -> str:
    shown = (f"{field.name}={getattr(self, field.name)!r}" for field in fields(self) if field.repr)
    return f"{type(self).__qualname__}({', '.join(shown)})"


def _comparisons(cls: Any, frozen: bool) -> dict[str, Any]:
    """``__eq__`` and ``__hash__``, which a class that is not frozen has not."""
    compared = [field.name for field in fields(cls) if field.compare]
    hashed = [f.name for f in fields(cls) if (f.compare if f.hash is None else f.hash)]

    def equal(self: Any, other: object) -> Any:
        if type(other) is not type(self):
            return NotImplemented
        # As tuples: what is the same object is equal, whatever it says itself.
        return [getattr(self, name) for name in compared] == [
            getattr(other, name) for name in compared
        ]

    def hash_of(self: Any) -> int:
        return hash(tuple([getattr(self, name) for name in hashed]))

    return {"__eq__": equal, "__hash__": hash_of if frozen else None}


def _guards(cls: Any) -> dict[str, Any]:
    """``__setattr__`` and ``__delattr__`` of a frozen class; one that derives may have more."""
    names = {field.name for field in fields(cls)}

    def setting(self: Any, name: str, value: object) -> None:
        if type(self) is cls or name in names:
            raise FrozenInstanceError(f"cannot assign to field {name!r}")
        super(cls, self).__setattr__(name, value)

    def deleting(self: Any, name: str) -> None:
        if type(self) is cls or name in names:
            raise FrozenInstanceError(f"cannot delete field {name!r}")
        super(cls, self).__delattr__(name)

    return {"__setattr__": setting, "__delattr__": deleting}
