"""A CasADi function evaluated on many rows at once, NumPy arrays in, NumPy arrays out.

Calling a CasADi function converts every argument; its buffer interface does not. One `Batched`
binds the arrays once and then costs only the arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from typing import Any, Final, NoReturn

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.elementwise import Elementwise, formula

# Rows that one mapped function takes. A mapped function lists the place of every number of all its
# rows, which for a million rows takes more memory than the numbers; many rows are so many at a
# time.
CHUNK: Final = 8192
# Rows from which on NumPy computes faster what CasADi says; and those from which on it does by as
# much as it takes to read a long function, one of so many instructions, in a few evaluations.
MANY: Final = 160
MANY_OF_LONG: Final = 400
LONG: Final = 2_000


class Batched:
    """``function`` mapped over ``n`` rows.

    Args:
        function: a CasADi function of column vectors.
        n: number of rows.
        shared: indices of the inputs that are the same for every row (given once, not n times).
        outputs: contiguous arrays (n, size) to write to; new ones by default.

    Attributes:
        inputs: one writable array per input, (n, size), or (size,) for a shared one. Fill them
            in place, then call.
        outputs: one array per output, (n, structural nonzeros in CasADi's column order),
            overwritten by every call.
    """

    def __init__(
        self,
        function: Any,
        n: int,
        shared: Sequence[int] = (),
        outputs: Sequence[FloatArray] | None = None,
    ) -> None:
        self.inputs: list[FloatArray] = [
            np.zeros(function.nnz_in(i) if i in shared else (n, function.nnz_in(i)))
            for i in range(function.n_in())
        ]
        self.outputs: list[FloatArray] = list(outputs or ()) or [
            np.zeros((n, function.nnz_out(i))) for i in range(function.n_out())
        ]
        rule = formula(function, tuple(shared)) if n >= _enough(function) else None
        if rule is not None:
            self._parts: list[Callable[[], object]] = [Elementwise(rule, self.inputs, self.outputs)]
        else:
            self._parts = list(self._mapped(function, n, tuple(shared)))

    def __reduce__(self) -> NoReturn:
        # A copy's operations would still fill the arrays of the original, or nobody's.
        raise TypeError("what is bound to its arrays cannot be pickled or copied")

    def __call__(self) -> list[FloatArray]:
        """Evaluate at what `inputs` hold now; the answer is `outputs`."""
        for part in self._parts:
            part()
        return self.outputs

    def _mapped(
        self, function: Any, n: int, shared: tuple[int, ...]
    ) -> Iterator[Callable[[], object]]:
        """CasADi's own evaluation of all rows, part by part."""
        for first in range(0, n, CHUNK):
            rows = slice(first, min(first + CHUNK, n))
            buffer, trigger = _mapped(function, rows.stop - first, shared).buffer()
            for i, array in enumerate(self.inputs):
                part = array if i in shared else array[rows]
                if array.size:
                    buffer.set_arg(i, memoryview(part.reshape(-1).data))
            for i, array in enumerate(self.outputs):
                if array.size:
                    buffer.set_res(i, memoryview(array[rows].reshape(-1).data))
            yield partial(_pull, trigger, buffer)


def _enough(function: Any) -> int:
    """Rows from which on NumPy takes less time."""
    long = function.is_a("SXFunction") and function.n_instructions() > LONG
    return MANY_OF_LONG if long else MANY


def _pull(trigger: Callable[[], object], buffer: Any) -> None:
    # The trigger does not keep its buffer alive.
    del buffer
    trigger()


# The same terms are solved again and again, over other unknowns or simulated readings.
@lru_cache(maxsize=128)
def _mapped(function: Any, n: int, shared: tuple[int, ...]) -> Any:
    return function.map(function.name() + "_rows", "serial", n, list(shared), [])
