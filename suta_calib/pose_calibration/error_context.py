"""Errors of a computation told as errors of the file its data came from."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from suta_calib.errors import InputError, SamplesError


@contextmanager
def error_context(file: Path | None = None, where: str = "") -> Iterator[None]:
    """Say in which file, and where in it, the data are that an `InputError` speaks of.

    Args:
        file: the file; an error that names one already keeps it.
        where: put before the place the error names, such as ``frame 3``.

    Raises:
        SamplesError: an `InputError` was raised within; says the same, and the place.
    """
    try:
        yield
    except InputError as error:
        raise SamplesError(
            error.found,
            error.expected,
            file=error.file or file,
            line=error.line,
            where=": ".join(filter(None, (where, error.where))),
            hint=error.hint,
        ) from error
