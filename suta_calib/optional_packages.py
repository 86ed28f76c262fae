"""Packages that only some commands need, imported when they are needed."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from suta_calib.errors import MissingExtraError


def load(module: str, extra: str) -> Any:
    """Import ``module``, which the optional extra ``extra`` of this package installs.

    Args:
        module: dotted name, as ``pyarrow.parquet``.
        extra: a name under ``[project.optional-dependencies]``.

    Returns:
        The module itself.

    Raises:
        MissingExtraError: it is not installed; the message is the command that installs it.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        name = error.name or module
        if name.partition(".")[0] != module.partition(".")[0]:
            raise  # installed, but broken: that is not for the user to mend with an extra
        raise missing(name, extra) from None


def require(package: str, extra: str) -> None:
    """Check that a package is installed, which another process will import.

    Raises:
        MissingExtraError: it is not installed; the message is the command that installs it.
    """
    if find_spec(package) is None:
        raise missing(package, extra)


def missing(package: str, extra: str) -> MissingExtraError:
    """The error that a package is not installed, which the extra ``extra`` brings."""
    return MissingExtraError(
        f"the Python package {package!r} is not installed; this needs it; "
        f"install it with: pip install 'suta_calib[{extra}]'"
    )
