"""Trials of a study on this process, on the cores of this computer, or on a Dask cluster.

A worker gets the study's data once, as bytes: arrays and names, no compiled functions and no paths.
So workers elsewhere need this package in the same version, but none of the job's files. On the
cores of this computer this process is one of the workers: it is at work while the others start,
which takes as long as a hundred trials of a small study.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
import signal
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Final

from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import BrokenProcessPool

from suta_calib.analysis.study.trial import StudyData, Trial, run_trial
from suta_calib.errors import InputError, SamplesError
from suta_calib.optional_packages import load

Task = tuple[int, int]  # size, number
# Trials handed out at a time; a worker has two such batches at the most, which is what an interrupt
# loses of it.
BATCH: Final = 4
# What keeps libraries from starting threads of their own beside the others'.
ONE_THREAD: Final = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "BLIS")
} | {"VECLIB_MAXIMUM_THREADS": "1"}

_loaded: dict[str, StudyData] = {}
# Threads of one worker would share CasADi's graph and the number of BLAS threads.
_one_at_a_time = threading.Lock()


def run_trials(
    data: StudyData, tasks: Sequence[Task], *, workers: int = 1, dask: str | None = None
) -> Iterator[Trial]:
    """Run trials, (size, number), in whatever order, on so many processes or on Dask."""
    if not tasks:
        return
    if dask is not None:
        batches = [tasks[k : k + BATCH] for k in range(0, len(tasks), BATCH)]
        yield from _on_dask(data, batches, dask)
    elif min(workers, len(tasks)) > 1:
        content, key = _packed(data)
        with _set_down(content) as place:
            yield from _beside_others(data, tasks, min(workers, len(tasks)), key, place)
    else:
        for size, number in tasks:
            yield run_trial(data, size, number)


@contextmanager
def _set_down(content: bytes) -> Iterator[Path | bytes]:
    """Where workers read the data: in a file, or beside every batch where none can be written.

    As an argument they would go through the pipe by which a worker is started, which holds little:
    this process would be at rest until the worker had imported what it needs, and the next one
    would not be started before.
    """
    place: Path | bytes = content
    with ExitStack() as resources:
        with suppress(OSError):
            folder = tempfile.TemporaryDirectory(prefix="suta_calib-", ignore_cleanup_errors=True)
            path = Path(resources.enter_context(folder)) / "study.pickle"
            path.write_bytes(content)
            place = path
        yield place


def _beside_others(
    data: StudyData, tasks: Sequence[Task], workers: int, key: str, place: Path | bytes
) -> Iterator[Trial]:
    waiting, running = deque(tasks), set[Future[list[Trial]]]()

    def hand_out() -> None:
        # Towards the end fewer at a time, and none in advance, so that all end together.
        ready = 2 if len(waiting) > 2 * BATCH * workers else 1
        while waiting and len(running) < ready * (workers - 1):
            count = max(1, min(BATCH, len(waiting) // (4 * workers)))
            batch = [waiting.popleft() for _ in range(count)]
            running.add(executor.submit(_run, key, place, batch))

    with _interrupts_withheld():
        # Seconds after which an unused worker ends.
        executor = get_reusable_executor(
            workers - 1, timeout=300, initializer=_prepare, env=ONE_THREAD
        )
    try:
        with _interrupts_withheld():
            hand_out()
        while waiting or running:
            hand_out()
            for done in [task for task in running if task.done()]:
                running.remove(done)
                yield from done.result()
            if waiting:
                yield run_trial(data, *waiting.popleft())
            else:
                wait(running, return_when=FIRST_COMPLETED)
    except BrokenProcessPool as error:
        raise InputError(
            f"a worker process that ended unexpectedly ({' '.join(str(error).split())[:200]})",
            "enough memory for every process",
            where="--jobs",
            hint="use fewer processes (--jobs), and continue with --resume",
        ) from None
    except BaseException:
        # Workers ignore an interrupt so as not to cry, and would finish their batch.
        _wait_until_passed_on(running)
        executor.shutdown(wait=True, kill_workers=True)
        raise


def _wait_until_passed_on(handed_out: set[Future[list[Trial]]]) -> None:
    """What has come to no worker when they are killed, the pool's own thread looks for in vain."""
    # A pool that is alive passes it on within milliseconds, s.
    end = time.monotonic() + 1.0
    while time.monotonic() < end and not all(f.running() or f.done() for f in handed_out):
        time.sleep(0.001)


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
                f"no connection to the scheduler any more ({type(error).__name__})",
                "a scheduler that runs until all trials are done",
                where=f"--dask {address}",
                hint="start it again, and continue with --resume",
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
    try:
        content = pickle.dumps(data, protocol=pickle.HIGHEST_PROTOCOL)
    except (pickle.PicklingError, AttributeError, TypeError) as problem:
        raise SamplesError(
            f"a term that cannot be sent to other processes ({problem})",
            "fields that are arrays, numbers and texts, and functions of a module",
            where="observations",
            hint="or use one process: --jobs 1",
        ) from None
    return content, hashlib.sha256(content).hexdigest()


def _prepare() -> None:
    """Make a process of its own ready; an interrupt it leaves to the one that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _run(key: str, place: Path | bytes, tasks: Sequence[Task]) -> list[Trial]:
    """A batch of trials; the data are unpacked once in each process."""
    with _one_at_a_time:
        if key not in _loaded:
            _loaded.clear()
            content = place if isinstance(place, bytes) else place.read_bytes()
            _loaded[key] = pickle.loads(content)
        return [run_trial(_loaded[key], size, number) for size, number in tasks]
