"""One BLAS thread for matrices of up to some thousand rows: more mostly wait for each other."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache, wraps
from threading import local
from typing import Any, Final, ParamSpec, TypeVar

from numpy import show_config
from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")
_within = local()
# What OpenBLAS, which the wheels of NumPy and SciPy have in them, reads when it is loaded.
VARIABLE: Final = "OPENBLAS_NUM_THREADS"


@cache
def _controller() -> Any:
    """Looked for once: that takes longer than the work."""
    return ThreadpoolController()


def _is_one() -> bool:
    """Whether there is but one thread from the start on, so that nothing needs to be looked for."""
    if os.environ.get(VARIABLE) != "1":
        return False

    built = show_config(mode="dicts") or {}
    return "openblas" in str(built.get("Build Dependencies", {}).get("blas", {}).get("name"))


def single_threaded(function: Callable[P, R]) -> Callable[P, R]:
    """Run a function with one BLAS thread; what was set before is restored afterwards.

    One that such a function calls finds the limit set: to ask takes a tenth of a millisecond.
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        if getattr(_within, "one", False) or _is_one():
            return function(*args, **kwargs)
        _within.one = True
        try:
            with _controller().limit(limits=1, user_api="blas"):
                return function(*args, **kwargs)
        finally:
            _within.one = False

    return limited
