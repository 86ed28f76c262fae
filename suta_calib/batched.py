"""A CasADi function evaluated on many rows at once, NumPy arrays in, NumPy arrays out.

Calling a CasADi function converts every argument; its buffer interface does not. One `Batched`
binds the arrays once and then costs only the arithmetic.

Of many rows NumPy does what the function says, on columns: CasADi's virtual machine takes some
nanoseconds for each instruction and row; an operation of NumPy on a column that stays in the cache
takes less than one. What depends on shared inputs alone is computed once, not once for each row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, Final, NoReturn

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray

# Rows that are computed at once: enough that Python's part is small, and few enough that all their
# columns stay in a core's cache.
HEIGHT: Final = 4096

# Where a number is: what of, and its place there.
Place = tuple[str, int, int]

Operation = Callable[..., Any]


def _if_else_zero(condition: FloatArray, value: FloatArray, out: FloatArray) -> None:
    # Zero times a value would not be zero where the value is not finite.
    out[...] = np.where(condition, value, 0.0)


def _twice(value: FloatArray, out: FloatArray) -> None:
    np.add(value, value, out)


# By the name of CasADi's code.
OPERATIONS: Final[dict[str, Operation]] = {
    "ADD": np.add,
    "SUB": np.subtract,
    "MUL": np.multiply,
    "DIV": np.divide,
    "NEG": np.negative,
    "SQ": np.square,
    "TWICE": _twice,
    "INV": np.reciprocal,
    "SQRT": np.sqrt,
    "POW": np.power,
    "CONSTPOW": np.power,
    "EXP": np.exp,
    "LOG": np.log,
    "SIN": np.sin,
    "COS": np.cos,
    "TAN": np.tan,
    "ASIN": np.arcsin,
    "ACOS": np.arccos,
    "ATAN": np.arctan,
    "ATAN2": np.arctan2,
    "HYPOT": np.hypot,
    "FABS": np.absolute,
    "SIGN": np.sign,
    "COPYSIGN": np.copysign,
    "FLOOR": np.floor,
    "CEIL": np.ceil,
    "FMIN": np.fmin,
    "FMAX": np.fmax,
    "LT": np.less,
    "LE": np.less_equal,
    "EQ": np.equal,
    "NE": np.not_equal,
    "NOT": np.logical_not,
    "AND": np.logical_and,
    "OR": np.logical_or,
    "IF_ELSE_ZERO": _if_else_zero,
}
_BY_CODE: Final = {getattr(ca, f"OP_{name}"): operation for name, operation in OPERATIONS.items()}


@dataclass(frozen=True, eq=False)
class Formula:
    """What a function computes, step by step, and where each number stands meanwhile.

    Attributes:
        once: operations with the places of their operands and of what they compute, that are the
            same for every row; `np.positive` copies what is also an answer.
        per_row: those on columns, in order.
        constants: by their place among the numbers that are the same for all rows.
        shared_places: how many of these there are.
        columns: how many columns it takes beside those of inputs and outputs.
    """

    once: tuple[tuple[Operation, tuple[Place, ...]], ...]
    per_row: tuple[tuple[Operation, tuple[Place, ...]], ...]
    constants: Mapping[int, float]
    shared_places: int
    columns: int


@lru_cache(maxsize=128)
def formula(
    function: Any, shared: tuple[int, ...], wanted: tuple[int, ...] | None = None
) -> Formula | None:
    """Read a CasADi function of column vectors; None where NumPy lacks an operation.

    Args:
        function: only an ``SXFunction`` consists of scalars.
        shared: indices of the inputs that are the same for every row.
        wanted: indices of the outputs that are computed, and numbered from 0 in this order; all by
            default.
    """
    if wanted is not None:
        whole = formula(function, shared)
        return None if whole is None else _only(whole, wanted)
    if not function.is_a("SXFunction"):
        return None
    steps = range(function.n_instructions())
    codes = [function.instruction_id(k) for k in steps]
    if not {*codes} <= _BY_CODE.keys() | {ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}:
        return None
    read = [function.instruction_input(k) for k in steps]
    written = [function.instruction_output(k) for k in steps]
    register = dict[int, Place]()
    once, per_row = list[Any](), list[Any]()
    constants, shared_places, columns = dict[int, float](), 0, 0
    for k, code in enumerate(codes):
        if code == ca.OP_INPUT:
            register[written[k][0]] = ("shared" if read[k][0] in shared else "input", *read[k])
            continue
        operands = tuple(register[r] for r in read[k])
        same = all(kind in ("alike", "shared") for kind, _, _ in operands)
        to = once if same else per_row
        if code == ca.OP_OUTPUT:
            to.append((np.positive, (*operands, ("output", *written[k]))))
            continue
        # CasADi uses a register again when its number is not needed any more.
        place: Place = ("column", 0, written[k][0])
        if same:
            place, shared_places = ("alike", 0, shared_places), shared_places + 1
        else:
            columns = max(columns, written[k][0] + 1)
        register[written[k][0]] = place
        if code == ca.OP_CONST:
            constants[place[2]] = function.instruction_constant(k)
        else:
            to.append((_BY_CODE[code], (*operands, place)))
    return Formula(tuple(once), tuple(per_row), constants, shared_places, columns)


def _only(whole: Formula, wanted: tuple[int, ...]) -> Formula:
    """A formula without the steps that only other outputs need."""
    number = {output: k for k, output in enumerate(wanted)}
    needed, kept = set[Place](), list[tuple[Operation, tuple[Place, ...]]]()
    for operation, (*operands, (kind, which, at)) in reversed((*whole.once, *whole.per_row)):
        place = kind, which, at
        if kind == "output" and which in number:
            place = kind, number[which], at
        elif place not in needed:
            continue
        # Before this step its place holds another number, or none.
        needed.discard(place)
        needed.update(operands)
        kept.append((operation, (*operands, place)))
    kept.reverse()
    same = ("alike", "shared")
    once = tuple(step for step in kept if all(kind in same for kind, _, _ in step[1][:-1]))
    per_row = tuple(step for step in kept if any(kind not in same for kind, _, _ in step[1][:-1]))
    return replace(whole, once=once, per_row=per_row)


class Elementwise:
    """A formula bound to arrays: a call fills the outputs from what the inputs hold then.

    Args:
        rule: what is computed.
        inputs: one array per input, (n, size), or (size,) for a shared one.
        outputs: one array per output, (n, size).
    """

    def __init__(
        self, rule: Formula, inputs: Sequence[FloatArray], outputs: Sequence[FloatArray]
    ) -> None:
        count = len(outputs[0])
        # Parts of equal height, so that the last one does not compute rows that are not there.
        self._height = -(-count // -(-count // HEIGHT))
        of_row = [np.zeros((a.shape[1] if a.ndim == 2 else 0, self._height)) for a in inputs]
        answers = [np.zeros((a.shape[1], self._height)) for a in outputs]
        shared = np.zeros((rule.shared_places, 1))
        for place, value in rule.constants.items():
            shared[place] = value
        self._inputs = [(a, b) for a, b in zip(inputs, of_row, strict=True) if a.ndim == 2]
        self._outputs = list(zip(outputs, answers, strict=True))
        stands = {
            "alike": [list(shared)],
            "shared": [list(a[:, None]) if a.ndim == 1 else [] for a in inputs],
            "input": [list(block) for block in of_row],
            "output": [list(block) for block in answers],
            "column": [list(np.zeros((rule.columns, self._height)))],
        }
        self._once, self._each = (
            [(do, [stands[kind][which][at] for kind, which, at in places]) for do, places in steps]
            for steps in (rule.once, rule.per_row)
        )

    def __call__(self) -> None:
        """Compute all rows."""
        with np.errstate(all="ignore"):
            for operation, operands in self._once:
                operation(*operands)
            for first in range(0, len(self._outputs[0][0]), self._height):
                rows = slice(first, first + self._height)
                for array, block in self._inputs:
                    chunk = array[rows].T
                    block[:, : chunk.shape[1]] = chunk
                for operation, operands in self._each:
                    operation(*operands)
                for array, block in self._outputs:
                    chunk = array[rows]
                    chunk[:] = block[:, : len(chunk)].T


# Rows that one mapped function takes. A mapped function lists the place of every number of all its
# rows, which for a million rows takes more memory than the numbers; many rows are so many at a
# time.
CHUNK: Final = 8192
# Rows from which on NumPy computes faster what CasADi says.
MANY: Final = 160


class Batched:
    """``function`` mapped over ``n`` rows.

    Args:
        function: a CasADi function of column vectors.
        n: number of rows.
        shared: indices of the inputs that are the same for every row (given once, not n times).
        outputs: contiguous arrays (n, size) to write to; new ones by default.
        wanted: indices of the outputs that are computed; all by default.
        inputs: those of another, which are then shared with it.

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
        wanted: tuple[int, ...] | None = None,
        inputs: list[FloatArray] | None = None,
    ) -> None:
        self.inputs: list[FloatArray] = inputs or [
            np.zeros(function.nnz_in(i) if i in shared else (n, function.nnz_in(i)))
            for i in range(function.n_in())
        ]
        self._wanted = range(function.n_out()) if wanted is None else wanted
        self.outputs: list[FloatArray] = list(outputs or ()) or [
            np.zeros((n, function.nnz_out(i))) for i in self._wanted
        ]
        rule = formula(function, tuple(shared), wanted) if n >= _enough(function) else None
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
            for i, array in zip(self._wanted, self.outputs, strict=True):
                if array.size:
                    buffer.set_res(i, memoryview(array[rows].reshape(-1).data))
            yield partial(_pull, trigger, buffer)


def _enough(function: Any) -> int:
    """Rows from which on NumPy takes less time, also for reading a long function a few times."""
    long = function.is_a("SXFunction") and function.n_instructions() > 2_000
    return 400 if long else MANY


def _pull(trigger: Callable[[], object], buffer: Any) -> None:
    # The trigger does not keep its buffer alive.
    del buffer
    trigger()


# The same terms are solved again and again, over other unknowns or simulated readings.
@lru_cache(maxsize=128)
def _mapped(function: Any, n: int, shared: tuple[int, ...]) -> Any:
    return function.map(function.name() + "_rows", "serial", n, list(shared), [])
