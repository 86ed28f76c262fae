"""Names of a package that are imported when they are first used, so that commands start quickly."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module, util
from pathlib import Path
from types import ModuleType
from typing import Any

Attribute = Callable[[str], Any]


def public(package: str) -> tuple[Attribute, list[str]]:
    """``__getattr__`` and ``__all__`` of a package (PEP 562), from what type checkers see of it.

    The names stand once in the package's ``__init__``, as imports that are never executed::

        if TYPE_CHECKING:
            from suta_calib.model.arm import ArmModel as ArmModel

        __getattr__, __all__ = public(__name__)

    Args:
        package: its full name.
    """
    source = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
    for_checkers = [
        node
        for node in ast.parse(source).body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    ]
    home = {
        alias.name: str(statement.module)
        for block in for_checkers
        for statement in block.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
        if alias.asname == alias.name
    }

    def attribute(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        return getattr(import_module(home[name]), name)

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
