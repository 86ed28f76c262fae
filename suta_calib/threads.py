"""One BLAS thread for matrices of up to some thousand rows: more mostly wait for each other."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from threading import local
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")
_controller = cache(ThreadpoolController)  # looked for once: that takes longer than the work
_within = local()


def single_threaded(function: Callable[P, R]) -> Callable[P, R]:
    """Run a function with one BLAS thread; what was set before is restored afterwards.

    One that such a function calls finds the limit set: to ask takes a tenth of a millisecond.
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        if getattr(_within, "one", False):
            return function(*args, **kwargs)
        _within.one = True
        try:
            with _controller().limit(limits=1, user_api="blas"):
                return function(*args, **kwargs)
        finally:
            _within.one = False

    return limited
