"""Pictures drawn by a process beside, while this one computes: on two cores nobody waits for them.

To import Matplotlib and to draw takes as long as the rest of a calibration. A picture is ordered by
the name of the function that draws it, as soon as its numbers are known. Where there is no studio,
or it fails, the picture is drawn here when a page asks for it, and whatever is wrong is seen then.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import dataclass
from importlib import import_module
from queue import SimpleQueue
from threading import Thread
from typing import IO, Any, Final, Self

from suta_calib.processes import started

# Bytes that say how long an order is.
_LENGTH: Final = 8

_open: ContextVar[Studio | None] = ContextVar("studio", default=None)


@dataclass(frozen=True)
class Drawing:
    """A call that draws a picture, here or elsewhere.

    Attributes:
        module, function: of the package, by name; it makes an SVG element.
        arguments: that can be pickled, of light types: the studio imports what defines them.
    """

    module: str
    function: str
    arguments: tuple[Any, ...]

    def __call__(self) -> str:
        """The SVG element."""
        return str(getattr(import_module(self.module), self.function)(*self.arguments))


def drawn(module: str, function: str, *arguments: Any) -> Callable[[], str]:
    """What a `document.Figure` draws with: ordered from the studio that is open, if one is.

    Args:
        module: full name of the module that draws.
        function: in it.
        arguments: of the function.
    """
    drawing, studio = Drawing(module, function, arguments), _open.get()
    return drawing if studio is None else studio.order(drawing)


class Studio:
    """A process that draws, from ``with`` on until its end.

    Args:
        module: full name of the module with the functions that will be asked for.

    Attributes:
        process: that draws.
    """

    def __init__(self, module: str) -> None:
        self._module = module

    def __enter__(self) -> Self:
        self.process = started(__name__, self._module)
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self._orders, self._pictures = self.process.stdin, self.process.stdout
        # In the order in which they were asked for; None for what it does not draw.
        self._asked, self._drawn = 0, list[str | None]()
        self._token = _open.set(self)
        return self

    def __exit__(self, *_: object) -> None:
        _open.reset(self._token)
        self.process.kill()
        for pipe in (self._orders, self._pictures):
            with suppress(OSError):
                pipe.close()
        self.process.wait()

    def order(self, drawing: Drawing) -> Callable[[], str]:
        """What gives the picture, and waits for it."""
        try:
            # Whole or not at all: what cannot be pickled must leave nothing in the pipe.
            order = pickle.dumps((drawing.module, drawing.function, drawing.arguments))
            self._orders.write(len(order).to_bytes(_LENGTH, "big") + order)
            self._orders.flush()
        except (OSError, ValueError, TypeError, AttributeError, pickle.PickleError):
            return drawing
        number, self._asked = self._asked, self._asked + 1
        return lambda: self._picture(number) or drawing()

    def _picture(self, number: int) -> str | None:
        while len(self._drawn) <= number:
            try:
                self._drawn.append(pickle.load(self._pictures))
            except (OSError, ValueError, EOFError, pickle.PickleError):
                return None
        return self._drawn[number]


def main() -> None:
    """Draw what is ordered on stdin, onto stdout, until there is no more."""
    # An interrupt is meant for the process that computes, which then ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # It lives for a few pictures, and looking for garbage takes a tenth of its time.
    gc.set_threshold(100_000, 20, 20)
    orders, pictures = SimpleQueue[bytes](), SimpleQueue[str | None]()
    # Who orders goes on at once, and comes for the pictures when all else is done.
    Thread(target=_take, args=(sys.stdin.buffer, orders), daemon=True).start()
    Thread(target=_hand_out, args=(sys.stdout.buffer, pictures), daemon=True).start()
    sys.stdout = sys.stderr
    import_module(sys.argv[1])
    while True:
        try:
            # Here, not where it is taken: what two threads import at once is there in part only.
            pictures.put(Drawing(*pickle.loads(orders.get()))())
        except Exception:  # noqa: BLE001 (whoever ordered it draws it himself, and sees)
            pictures.put(None)


def _take(pipe: IO[bytes], orders: SimpleQueue[bytes]) -> None:
    """Queue orders; whoever gave them is gone when there are no more."""
    try:
        while length := int.from_bytes(pipe.read(_LENGTH), "big"):
            orders.put(pipe.read(length))
    finally:
        os._exit(0)


def _hand_out(pipe: IO[bytes], pictures: SimpleQueue[str | None]) -> None:
    """Write pictures as far as somebody takes them."""
    try:
        while True:
            pickle.dump(pictures.get(), pipe)
            pipe.flush()
    finally:
        os._exit(0)


if __name__ == "__main__":
    main()
