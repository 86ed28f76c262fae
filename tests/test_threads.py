"""One BLAS thread within, as many as before afterwards."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from suta_calib.threads import single_threaded

VARIABLE = "OPENBLAS_NUM_THREADS"


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


@pytest.mark.parametrize("asked", [None, "2"])
def test_a_command_has_one_thread_from_the_start_unless_another_number_is_asked_for(
    asked: str | None,
) -> None:
    code = (
        "import atexit, sys\n"
        "from suta_calib.cli import main\n"
        "def say():\n"
        "    import numpy as np, threadpoolctl\n"
        "    np.eye(3) @ np.eye(3)\n"
        "    print(*{p['num_threads'] for p in threadpoolctl.threadpool_info()})\n"
        "atexit.register(say)\n"
        "sys.argv[1:] = ['--version']\n"
        "main()"
    )
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    environment |= {} if asked is None else {VARIABLE: asked}
    run = [sys.executable, "-c", code]
    said = subprocess.run(run, env=environment, capture_output=True, text=True, check=True).stdout
    assert said.splitlines()[-1] == (asked or "1")
