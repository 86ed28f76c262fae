"""Trials of a study on this process, on the cores of this computer, or on a Dask cluster.

A worker gets the study's data once, as bytes: arrays and names, no compiled functions and no paths.
So workers elsewhere need this package in the same version, but none of the job's files.
"""

from __future__ import annotations

import hashlib
import logging
import multiprocessing
import pickle
import signal
import threading
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.analysis.study.trial import StudyData, Trial, run_trial
from suta_calib.errors import InputError
from suta_calib.extras import load

Task = tuple[int, int]  # size, number
# Trials handed out at a time: an interrupt loses no more than these for each worker.
BATCH: Final = 4

_loaded: dict[str, StudyData] = {}
# Threads of one worker would share CasADi's graph and the number of BLAS threads.
_one_at_a_time = threading.Lock()


def run_trials(
    data: StudyData, tasks: Sequence[Task], *, workers: int = 1, dask: str | None = None
) -> Iterator[Trial]:
    """Run trials, (size, number), in whatever order they are done, on so many processes or on Dask.

    Raises:
        MissingExtraError: a Dask cluster is asked for and `distributed` is not installed.
        InputError: no scheduler answers at the address, or its workers lack this package.
    """
    batches = [tasks[k : k + BATCH] for k in range(0, len(tasks), BATCH)]
    if not batches:
        return
    if dask is not None:
        yield from _on_dask(data, batches, dask)
    elif min(workers, len(batches)) > 1:
        yield from _on_cores(data, batches, min(workers, len(batches)))
    else:
        for size, number in tasks:
            yield run_trial(data, size, number)


def _on_cores(data: StudyData, batches: Sequence[Sequence[Task]], workers: int) -> Iterator[Trial]:
    from joblib import Parallel, delayed, parallel_config
    from joblib.externals.loky import get_reusable_executor
    from joblib.externals.loky.process_executor import BrokenProcessPool

    content, key = _packed(data)
    # An array, because joblib shares a large one between processes instead of sending it along.
    shared = np.frombuffer(content, dtype=np.uint8)
    with parallel_config("loky", n_jobs=workers, inner_max_num_threads=1):
        try:
            with _interrupts_withheld():
                results = Parallel(return_as="generator_unordered", batch_size=1)(
                    delayed(_run_local)(key, shared, batch) for batch in batches
                )
            for found in results:
                yield from found
        except BrokenProcessPool as error:
            raise InputError(
                f"a worker that died ({' '.join(str(error).split())[:200]})",
                "memory for every process",
                where="--jobs",
                hint="take fewer, and go on with --resume",
            ) from None
        except BaseException:
            # Workers ignore an interrupt so as not to cry, and would finish their batch. What is
            # cancelled is known: joblib would advise another way of handing out tasks.
            warnings.filterwarnings("ignore", message=".*still being processed by the workers")
            get_reusable_executor().shutdown(wait=True, kill_workers=True)
            raise


@contextmanager
def _interrupts_withheld() -> Iterator[None]:
    """Processes started meanwhile do not hear of an interrupt, which comes afterwards.

    Until a worker has imported what it needs it cannot ignore one itself, and cries.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Its start lets interrupts through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _on_dask(data: StudyData, batches: Sequence[Sequence[Task]], address: str) -> Iterator[Trial]:
    distributed = load("distributed", "dask")
    content, key = _packed(data)
    with _client(distributed, address) as client:
        shared = client.scatter(content, broadcast=True, hash=False)
        futures = client.map(_run, [key] * len(batches), [shared] * len(batches), batches)
        try:
            for future in distributed.as_completed(futures, loop=client.loop):
                yield from future.result()
        except (ImportError, AttributeError, distributed.KilledWorker) as error:
            raise InputError(
                f"a worker that cannot run a trial ({error})",
                "workers with suta_calib installed, in this version",
                where=f"--dask {address}",
            ) from None
        except (CancelledError, OSError) as error:
            raise InputError(
                f"a scheduler that went away ({type(error).__name__})",
                "one that stays until all trials are done",
                where=f"--dask {address}",
                hint="start it again, and go on with --resume",
            ) from None
        finally:
            # What is left runs on for nobody; a scheduler that is gone need not be told.
            with suppress(CancelledError, OSError):
                client.cancel(futures)


@contextmanager
def _client(distributed: Any, address: str) -> Iterator[Any]:
    """A client of a scheduler that is there."""
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
        yield client
        # Not where that failed: what is logged then comes when nobody waits for it any more.
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)
    finally:
        client.close()


def _packed(data: StudyData) -> tuple[bytes, str]:
    """The study's data as bytes, and a name for them."""
    content = pickle.dumps(data, protocol=pickle.HIGHEST_PROTOCOL)
    return content, hashlib.sha256(content).hexdigest()


def _run_local(key: str, content: NDArray[np.uint8], tasks: Sequence[Task]) -> list[Trial]:
    """A batch in a process of its own, which leaves an interrupt to the one that started it."""
    if multiprocessing.parent_process() is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    return _run(key, content, tasks)


def _run(key: str, content: bytes | NDArray[np.uint8], tasks: Sequence[Task]) -> list[Trial]:
    """A batch of trials; the data are unpacked once in each process."""
    with _one_at_a_time:
        if key not in _loaded:
            _loaded.clear()
            _loaded[key] = pickle.loads(bytes(content))
        return [run_trial(_loaded[key], size, number) for size, number in tasks]
