"""Arguments of another class than a function takes, refused in words where it is called."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from types import UnionType
from typing import Any, Final, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from suta_calib.errors import InputError

P = ParamSpec("P")
R = TypeVar("R")
_WORDS: Final[dict[Any, str]] = {Real: "number", Integral: "whole number", Iterable: "sequence"}


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Refuse arguments that are no instances of what a public function's annotations name.

    What is in a sequence is not looked at, nor an array.
    """
    signature = inspect.signature(function)

    @cache
    def classes() -> dict[str, tuple[type, ...]]:
        return {name: _classes(hint) for name, hint in get_type_hints(function).items()}

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            expected = classes().get(name)
            text = isinstance(value, str) and str not in (expected or [str])
            if text or not isinstance(value, expected or object):
                names = [_WORDS.get(k, k.__name__) for k in expected or () if k is not type(None)]
                where = f"{function.__name__}: {name}"
                raise InputError(type(value).__name__, " or ".join(names), where=where)
        return function(*args, **kwargs)

    return call


def _classes(hint: Any) -> tuple[type, ...]:
    """What an argument may be an instance of; nothing where that is not known."""
    options = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    wider: dict[Any, type] = {float: Real, int: Integral, Sequence: Iterable}
    kinds = [get_origin(option) or option for option in options]
    checkable = all(isinstance(kind, type) and kind is not np.ndarray for kind in kinds)
    return tuple(wider.get(kind, kind) for kind in kinds) if checkable else ()
