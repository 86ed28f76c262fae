"""One BLAS thread within, as many as before afterwards."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from suta_calib.threads import single_threaded


def blas_threads() -> set[int]:
    # What OpenBLAS has after a product: it starts threads when it needs them.
    np.eye(3) @ np.eye(3)
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@single_threaded
def inner(fails: bool) -> set[int]:
    if fails:
        raise ValueError("spoilt")
    return blas_threads()


@single_threaded
def outer(fails: bool) -> set[int]:
    return inner(fails) | blas_threads()


def test_a_call_within_a_call_keeps_the_limit_and_the_outer_one_gives_back_what_was() -> None:
    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        for _ in range(2):
            assert outer(False) == {1}
            with pytest.raises(ValueError, match="spoilt"):
                outer(True)
            assert blas_threads() == before
