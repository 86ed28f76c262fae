"""The same work on many things, each in a worker process: none stops the others.

Every worker has a pool of its own, so that what ended a process is known: the one thing that was
worked on there. That thing is tried once more when all others are done, by the only worker that is
left. Two large jobs may lack the memory that each alone would have.
"""

from __future__ import annotations

import os
import re
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeVar

from joblib.externals.loky import ProcessPoolExecutor
from joblib.externals.loky.process_executor import BrokenProcessPool

from suta_calib.processes import (
    ONE_THREAD,
    dask_client,
    dask_trouble,
    interrupts_withheld,
    prepare,
    wait_until_passed_on,
)

T = TypeVar("T")
R = TypeVar("R")
# Threads of one worker of Dask would share CasADi's graph and the number of BLAS threads.
_one_at_a_time = threading.Lock()
# Where loky says how a worker ended: its signal or its exit code.
_HOW_IT_ENDED: Final = re.compile(r"exit codes of the workers are \{([^}]+)\}")
_LONGEST_REASON: Final = 200


@dataclass(frozen=True)
class Crash:
    """Instead of an answer: the worker process ended, and why as far as that is known."""

    reason: str


def work_through(
    work: Callable[[T], R], things: Sequence[T], *, workers: int = 1, dask: str | None = None
) -> Iterator[tuple[int, R | Crash]]:
    """Do the work on each thing by itself, and give what came of it as it is done.

    Args:
        work: a function of a module; it raises nothing, unless the fault is this package's.
        things: to work on; they can be pickled, and so can what the work returns.
        workers: processes on this computer.
        dask: address of the scheduler of a Dask cluster that does it in their place.

    Yields:
        The number of a thing, and what its work returned, or `Crash`.

    Raises:
        InputError: there is no such cluster, or it is gone.
    """
    if dask is not None:
        yield from _on_dask(work, things, dask)
    elif things:
        yield from _on_processes(work, things, min(workers, len(things)))


def _on_processes(
    work: Callable[[T], R], things: Sequence[T], workers: int
) -> Iterator[tuple[int, R | Crash]]:
    idle = [_pool() for _ in range(workers)]
    waiting, again = deque(range(len(things))), deque[int]()
    running = dict[Future[R], tuple[int, Any]]()
    alone = False
    try:
        while waiting or running or again:
            if again and not waiting and not running:
                waiting, again, alone = again, deque(), True
            while waiting and idle and not (alone and running):
                number, pool = waiting.popleft(), idle.pop()
                with interrupts_withheld():
                    running[pool.submit(work, things[number])] = number, pool
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                number, pool = running.pop(future)
                try:
                    answer: R | Crash | None = future.result()
                except BrokenProcessPool as error:
                    pool.shutdown(wait=True, kill_workers=True)
                    pool, answer = _pool(), Crash(_brief(error)) if alone else None
                idle.append(pool)
                if answer is None:
                    again.append(number)
                else:
                    yield number, answer
    finally:
        # Workers ignore an interrupt, and would finish what they do.
        wait_until_passed_on(running)
        for pool in (*idle, *(pool for _, pool in running.values())):
            pool.shutdown(wait=True, kill_workers=True)


Submit = Callable[[Callable[[Any], Any], Any], Future[Any]]


@contextmanager
def seats(workers: int, dask: str | None = None) -> Iterator[list[Submit]]:
    """Places where work goes on that remembers what came before: each is always the same process.

    Gives a function for each that has some work done on one thing there, in order. `outcome` says
    what came of it. With one worker it is done here, at once.

    Raises:
        InputError: no cluster at that address.
    """
    if dask is not None:
        with dask_client(dask) as (_, client):
            yield [partial(_submit_on, client, address) for address in client.nthreads()]
    elif workers == 1:
        yield [_submit_here]
    else:
        pools = [_Seat() for _ in range(workers)]
        try:
            yield [pool.submit for pool in pools]
        finally:
            for pool in pools:
                pool.close()


def outcome(future: Future[Any]) -> Any:
    """What some work returned; `Crash` where its process ended."""
    try:
        return future.result()
    except (BrokenProcessPool, CancelledError, OSError) as error:
        return Crash(_brief(error))
    except Exception as error:
        if type(error).__name__ in ("KilledWorker", "FutureCancelledError"):
            return Crash(_brief(error))
        raise


class _Seat:
    """One worker process, and after its end another one."""

    def __init__(self) -> None:
        self._pool = _pool()

    def submit(self, work: Callable[[T], R], thing: T) -> Future[R]:
        """Have some work done."""
        with interrupts_withheld():
            try:
                future: Future[R] = self._pool.submit(work, thing)
            except BrokenProcessPool:
                self.close()
                self._pool = _pool()
                future = self._pool.submit(work, thing)
        return future

    def close(self) -> None:
        """End it, whatever it does."""
        self._pool.shutdown(wait=True, kill_workers=True)


def _submit_here(work: Callable[[T], R], thing: T) -> Future[R]:
    future = Future[R]()
    future.set_result(work(thing))
    return future


def _submit_on(client: Any, address: str, work: Callable[[T], R], thing: T) -> Future[R]:
    future: Future[R] = client.submit(
        _alone, work, thing, workers=[address], allow_other_workers=False, pure=False
    )
    return future


def _pool() -> Any:
    """A pool of one worker, which starts with the first thing that it is given."""
    return ProcessPoolExecutor(1, initializer=prepare, initargs=(os.getpid(),), env=ONE_THREAD)


def _brief(error: BaseException) -> str:
    text = " ".join(str(error).split())
    ended = _HOW_IT_ENDED.search(text)
    return ended[1] if ended else text[:_LONGEST_REASON] or type(error).__name__


def _on_dask(
    work: Callable[[T], R], things: Sequence[T], address: str
) -> Iterator[tuple[int, R | Crash]]:
    with dask_client(address) as (distributed, client):
        futures = client.map(partial(_alone, work), things, pure=False)
        numbers = {future.key: number for number, future in enumerate(futures)}
        try:
            with dask_trouble(address, "job"):
                for future in distributed.as_completed(futures, loop=client.loop):
                    try:
                        answer: R | Crash = future.result()
                    except distributed.KilledWorker as error:
                        answer = Crash(_brief(error))
                    yield numbers[future.key], answer
        finally:
            # What is left runs on for nobody; a scheduler that is gone need not be told.
            with suppress(CancelledError, OSError):
                client.cancel(futures)


def _alone(work: Callable[[T], R], thing: T) -> R:
    with _one_at_a_time:
        return work(thing)
