"""Classes found by name: those of this package, and those of other packages by entry point.

A package adds a class with an entry point in one of the `Group`s. The entry point's name is the
name of the class. In its ``pyproject.toml``:

    [project.entry-points."suta_calib.kinds"]
    inclinometer = "my_package.inclinometer:Inclinometer"
"""

from __future__ import annotations

import inspect
import pkgutil
import warnings
from collections.abc import Collection, Iterable, Mapping
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from threading import RLock
from typing import Any, Final, Literal, TypeVar

from suta_calib.errors import SutaCalibWarning

Group = Literal["kinds", "readers", "writers", "device_formats", "hypotheses"]
Base = TypeVar("Base")
Value = TypeVar("Value")

_PACKAGE: Final = __name__.partition(".")[0]
_found: Final[dict[Group, dict[str, Any]]] = {}
_lock: Final = RLock()


def classes_of(package: str, base: type[Base]) -> dict[str, type[Base]]:
    """The concrete subclasses of ``base`` that the modules of a package of ours define, by name."""
    modules = (f"{package}.{m.name}" for m in pkgutil.iter_modules(import_module(package).__path__))
    return {
        _name(value): value
        for module in modules
        for value in vars(import_module(module)).values()
        if isinstance(value, type)
        and issubclass(value, base)
        and value.__module__ == module
        and not inspect.isabstract(value)
    }


def other_classes(
    group: Group, base: type[Base], ours: Collection[str]
) -> Mapping[str, type[Base]]:
    """The classes that other packages add to a group, by name; each is loaded once.

    Args:
        group: of the entry points, without ``suta_calib.`` before it.
        base: the class they must be of.
        ours: names that are taken.

    Warns:
        SutaCalibWarning: a class cannot be loaded or used, or its name is taken. It is left out.
    """
    with _lock:
        if group not in _found:
            # A package that asks for the group while it is loaded gets what was found before it.
            _found[group] = {}
            points = entry_points(group=f"{_PACKAGE}.{group}")
            for point in sorted(set(points), key=lambda point: (point.name, point.value)):
                found, problem = _loaded(point, base, {*ours, *_found[group]})
                if found is not None:
                    _found[group][point.name] = found
                else:
                    owner = "" if point.dist is None else f" of the package {point.dist.name}"
                    warnings.warn(
                        f"{point.group}: {point.name}{owner} is left out: {problem}",
                        SutaCalibWarning,
                        stacklevel=2,
                    )
        return _found[group]


def all_classes(group: Group, base: type[Base], package: str) -> dict[str, type[Base]]:
    """The classes in the modules of a package of ours, then other packages' ones, by name."""
    ours = classes_of(package, base)
    return {**ours, **other_classes(group, base, ours)}


def shipped(known: Mapping[str, Value]) -> dict[str, Value]:
    """Those of some classes, or of their objects, by name, that this package defines itself."""
    return {name: value for name, value in known.items() if _is_shipped(value)}


def _is_shipped(value: object) -> bool:
    home = value if isinstance(value, type) else type(value)
    return home.__module__.partition(".")[0] == _PACKAGE


def _loaded(
    point: EntryPoint, base: type[Base], taken: Collection[str]
) -> tuple[type[Base] | None, str]:
    """The class of an entry point, or None and why it cannot be used."""
    if point.name in taken:
        return None, f"found the name {point.name!r}, which is taken; give it another name"
    try:
        value = point.load()
    except (Exception, SystemExit) as problem:  # noqa: BLE001 (a stranger's module may raise anything)
        reason = f"{type(problem).__name__}: {problem}"
        return None, f"{point.value} cannot be loaded ({reason}); repair or uninstall it"
    if not (isinstance(value, type) and issubclass(value, base)):
        return None, f"found {point.value}; expected a subclass of {_path(base)}"
    if missing := [*sorted(getattr(value, "__abstractmethods__", ())), *_undeclared(value)]:
        return None, f"{point.value} does not define {', '.join(missing)}"
    if _name(value) != point.name:
        return None, (
            f"{point.value} calls itself {_name(value)!r}; expected {point.name!r}, the name of "
            "the entry point"
        )
    return value, ""


def _undeclared(value: type) -> Iterable[str]:
    """Class attributes that its bases ask for and that it does not set."""
    declared = {n: a for base in value.__mro__ for n, a in inspect.get_annotations(base).items()}
    return sorted(
        name
        for name, annotation in declared.items()
        if str(annotation).startswith("ClassVar") and not hasattr(value, name)
    )


def _name(value: type) -> str:
    """What a class is called: its ``kind``, or its ``name``."""
    return str(getattr(value, "kind", None) or getattr(value, "name", value.__name__))


def _path(value: type) -> str:
    return f"{value.__module__}.{value.__qualname__}"
