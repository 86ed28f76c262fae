"""Worker processes: on the cores of this computer by loky, elsewhere by Dask."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any, Final

from suta_calib.errors import InputError
from suta_calib.optional_packages import load

# What keeps libraries from starting threads of their own beside the others'.
ONE_THREAD: Final = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "BLIS")
} | {"VECLIB_MAXIMUM_THREADS": "1"}


def prepare(starter: int) -> None:
    """Make a worker ready; an interrupt or SIGTERM it leaves to the process that started it.

    ``timeout`` and systemd send SIGTERM to the whole group of processes.

    Args:
        starter: that process's number. When that one is gone (``kill -9``), the worker ends too:
            nobody waits for what it does, and it would be at work beside the next run.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_after, args=(starter,), daemon=True).start()


def _end_after(starter: int) -> None:
    # How long a worker outlives whoever started it, s.
    looks = 1.0
    while os.getppid() == starter:
        time.sleep(looks)
    os._exit(1)


def wait_until_passed_on(handed_out: Iterable[Future[Any]]) -> None:
    """Before workers are killed: what has come to none, the pool's own thread looks for in vain."""
    # A pool that is alive passes it on within milliseconds, s.
    end = time.monotonic() + 1.0
    while time.monotonic() < end and not all(f.running() or f.done() for f in handed_out):
        time.sleep(0.001)


@contextmanager
def interrupts_withheld() -> Iterator[None]:
    """Processes started meanwhile do not hear of an interrupt or SIGTERM, which comes afterwards.

    Until a worker has imported what it needs it cannot ignore one itself, and cries.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Its start lets interrupts through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def dask_client(address: str) -> Iterator[tuple[Any, Any]]:
    """The module `distributed`, and a client of a scheduler that is there.

    Args:
        address: of the scheduler, such as ``tcp://host:8786``.

    Raises:
        MissingExtraError: Dask is not installed.
        InputError: there is no scheduler, or it has no workers.
    """
    distributed = load("distributed", "dask")
    logs = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
    levels = [log.level for log in logs]
    for log in logs:
        # Their tracebacks would stand beside our one line.
        log.setLevel(logging.CRITICAL)
    try:
        # A client that fails half-way through its construction cries when it is collected: first
        # see whether the address has a port, and a scheme somebody knows.
        scheme, place = distributed.comm.parse_address(address)
        distributed.comm.registry.get_backend(scheme)
        if scheme != "inproc":
            distributed.comm.addressing.parse_host_port(place)
        client = distributed.Client(address, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"no scheduler ({reason})",
            "the address of a running Dask scheduler, such as tcp://host:8786",
            where=f"--dask {address}",
        ) from None
    try:
        if not client.scheduler_info()["workers"]:
            raise InputError(
                "a scheduler without workers", "at least one", where=f"--dask {address}"
            )
        yield distributed, client
        # Not where that failed: what is logged then comes when nobody waits for it any more.
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)
    finally:
        client.close()


@contextmanager
def dask_trouble(address: str, work: str) -> Iterator[None]:
    """Within it, what goes wrong on a cluster is said in the user's words.

    Raises:
        InputError: the scheduler is gone, or its workers lack this package.
    """
    where = f"--dask {address}"
    try:
        yield
    except (ImportError, AttributeError) as error:
        raise InputError(
            f"a worker that cannot run a {work} ({error})",
            "workers with suta_calib installed, in this version",
            where=where,
        ) from None
    except (CancelledError, OSError) as error:
        raise InputError(
            f"no connection to the scheduler any more ({type(error).__name__})",
            f"a scheduler that runs until every {work} is done",
            where=where,
            hint="start it again, and continue with --resume",
        ) from None
