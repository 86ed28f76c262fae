"""Pictures drawn by a process beside, while this one computes: on two cores nobody waits for them.

To import Matplotlib and to draw takes as long as the rest of a calibration. A picture is ordered by
the name of the function that draws it, as soon as its numbers are known. Where there is no studio,
or it fails, the picture is drawn here when a page asks for it, and whatever is wrong is seen then.
"""

from __future__ import annotations

import gc
import pickle
import signal
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Self

from suta_calib.processes import started

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
        # One order after the other: pipes hold less than a picture.
        self._clerk = ThreadPoolExecutor(1)
        self._token = _open.set(self)
        return self

    def __exit__(self, *_: object) -> None:
        _open.reset(self._token)
        # Whoever waits for a picture by now is told that there will be none.
        self.process.kill()
        self._clerk.shutdown(cancel_futures=True)
        for pipe in (self.process.stdin, self.process.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]  # both were asked for
        self.process.wait()

    def order(self, drawing: Drawing) -> Callable[[], str]:
        """What gives the picture, once it is drawn."""
        picture: Future[str | None] = self._clerk.submit(self._ask, drawing)

        def given() -> str:
            return picture.result() or drawing()

        return given

    def _ask(self, drawing: Drawing) -> str | None:
        """The picture; None where the studio does not draw it."""
        orders, pictures = self.process.stdin, self.process.stdout
        assert orders is not None
        assert pictures is not None
        try:
            # Whole or not at all: what cannot be pickled must leave nothing in the pipe.
            order = pickle.dumps((drawing.module, drawing.function, drawing.arguments))
            orders.write(order)
            orders.flush()
            found: str | None = pickle.load(pictures)
        except (OSError, ValueError, EOFError, TypeError, AttributeError, pickle.PickleError):
            return None
        return found


def main() -> None:
    """Draw what is ordered on stdin, onto stdout, until there is no more."""
    # An interrupt is meant for the process that computes, which then ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # It lives for a few pictures, and looking for garbage takes a tenth of its time.
    gc.set_threshold(100_000, 20, 20)
    orders, pictures = sys.stdin.buffer, sys.stdout.buffer
    sys.stdout = sys.stderr
    with suppress(EOFError, OSError):
        import_module(sys.argv[1])
        while True:
            order = Drawing(*pickle.load(orders))
            try:
                picture = order()
            except Exception:  # noqa: BLE001 (whoever ordered it draws it himself, and sees)
                picture = None
            pickle.dump(picture, pictures)
            pictures.flush()


if __name__ == "__main__":
    main()
