"""Names of a package that are imported when they are first used, so that commands start quickly."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from importlib import import_module, util
from pathlib import Path
from types import ModuleType
from typing import Any, Final

Attribute = Callable[[str], Any]

# Parts of NumPy that SciPy's first import would load, only to have their names: two thirds of the
# time that it takes.
UNUSED_OF_NUMPY: Final = ("f2py", "testing", "ma", "polynomial", "ctypeslib", "char", "rec")
# An import that is never executed; ruff writes it on one line, or each name on its own.
_IMPORT: Final = re.compile(r"^    from (\S+) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)
_NAME: Final = re.compile(r"\b(\w+) as \1\b")


def public(package: str) -> tuple[Attribute, list[str]]:
    """``__getattr__`` and ``__all__`` of a package (PEP 562), from what type checkers see of it.

    The package's ``__dir__`` lists the same names, for whoever completes them with the tab key.

    The names stand once in the package's ``__init__``, as imports that are never executed::

        if TYPE_CHECKING:
            from suta_calib.model.arm import ArmModel as ArmModel

        __getattr__, __all__ = public(__name__)

    Args:
        package: its full name.
    """
    source = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
    _, _, for_checkers = source.partition("\nif TYPE_CHECKING:\n")
    home = {
        name: found[1]
        for found in _IMPORT.finditer(for_checkers)
        for name in _NAME.findall(found[2] or found[3])
    }

    def attribute(name: str) -> Any:
        if name in home:
            return getattr(import_module(home[name]), name)
        # Its own modules, such as `suta_calib.robots`, need no import of their own.
        if not name.startswith("_") and util.find_spec(f"{package}.{name}") is not None:
            return import_module(f"{package}.{name}")
        raise AttributeError(f"module '{package}' has no attribute '{name}'")

    def listed() -> list[str]:
        own = vars(sys.modules[package])
        inside = [name for name in own if f"{package}.{name}" in sys.modules]
        return sorted({*home, *inside, *(name for name in own if name.startswith("__"))})

    vars(sys.modules[package])["__dir__"] = listed
    return attribute, sorted(home)


def later(module: str) -> ModuleType:
    """A module that is imported when something of it is first used.

    Args:
        module: its full name.
    """
    if module in sys.modules:
        return sys.modules[module]
    spec = util.find_spec(module)
    assert spec is not None
    assert spec.loader is not None
    spec.loader = util.LazyLoader(spec.loader)
    found = util.module_from_spec(spec)
    sys.modules[module] = found
    spec.loader.exec_module(found)
    return found


def spare(package: str, parts: Iterable[str]) -> None:
    """Parts of somebody's package that are imported when they are used, and not when named.

    Args:
        package: its full name; it has been imported.
        parts: modules in it.
    """
    home = vars(sys.modules[package])
    for part in parts:
        if part not in home:
            home[part] = later(f"{package}.{part}")
