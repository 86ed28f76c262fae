"""Trials of a study on this process, on the cores of this computer, or on a Dask cluster.

A worker gets the study's data once, as bytes: arrays and names, no compiled functions and no paths.
So workers elsewhere need this package in the same version, but none of the job's files. On the
cores of this computer this process is one of the workers: it is at work while the others start,
which takes as long as a hundred trials of a small study.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import BrokenProcessPool

from suta_calib.analysis.study.trial import StudyData, Trial, run_trial
from suta_calib.errors import InputError, SamplesError
from suta_calib.processes import (
    ONE_THREAD,
    dask_client,
    dask_trouble,
    interrupts_withheld,
    prepare,
    wait_until_passed_on,
)

Task = tuple[int, int]  # size, number
# Trials handed out at a time; a worker has two such batches at the most, which is what an interrupt
# loses of it.
BATCH: Final = 4
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

    with interrupts_withheld():
        # Seconds after which an unused worker ends.
        executor = get_reusable_executor(
            workers - 1, timeout=300, initializer=prepare, initargs=(os.getpid(),), env=ONE_THREAD
        )
    try:
        with interrupts_withheld():
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
        wait_until_passed_on(running)
        executor.shutdown(wait=True, kill_workers=True)
        raise


def _on_dask(data: StudyData, batches: Sequence[Sequence[Task]], address: str) -> Iterator[Trial]:
    content, key = _packed(data)
    with dask_client(address) as (distributed, client):
        shared = client.scatter(content, broadcast=True, hash=False)
        futures = client.map(_run, [key] * len(batches), [shared] * len(batches), batches)
        try:
            with dask_trouble(address, "trial"):
                for future in distributed.as_completed(futures, loop=client.loop):
                    yield from future.result()
        except distributed.KilledWorker as error:
            raise InputError(
                f"a worker that ended unexpectedly ({error})",
                "enough memory for every worker",
                where=f"--dask {address}",
                hint="continue with --resume",
            ) from None
        finally:
            # What is left runs on for nobody; a scheduler that is gone need not be told.
            with suppress(CancelledError, OSError):
                client.cancel(futures)


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


def _run(key: str, place: Path | bytes, tasks: Sequence[Task]) -> list[Trial]:
    """A batch of trials; the data are unpacked once in each process."""
    with _one_at_a_time:
        if key not in _loaded:
            _loaded.clear()
            content = place if isinstance(place, bytes) else place.read_bytes()
            _loaded[key] = pickle.loads(content)
        return [run_trial(_loaded[key], size, number) for size, number in tasks]
