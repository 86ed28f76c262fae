"""What users import is public, and what is public can be imported."""

from __future__ import annotations

import ast
import json
import pkgutil
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
from shown_blocks import BLOCKS, PACKAGES

import suta_calib

# Single modules directly below the root are public as they are.
MODULES = sorted(
    module.name
    for module in pkgutil.iter_modules(suta_calib.__path__, "suta_calib.")
    if not module.ispkg and not module.name.endswith("__main__")
)


def imported(source: str) -> Iterator[tuple[str, str]]:
    """Module and name of everything that a script imports from suta_calib."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "suta_calib":
            yield from ((str(node.module), alias.name) for alias in node.names)


def inner(source: str) -> list[str]:
    """Imports of what is not public: neither in ``__all__`` of the root nor of a package."""
    found = []
    for module, name in imported(source):
        if module in MODULES or (module == "suta_calib" and f"{module}.{name}" in MODULES):
            continue
        public = getattr(import_module(module), "__all__", ()) if is_public(module) else ()
        if name not in public and f"{module}.{name}" not in PACKAGES:
            found.append(f"from {module} import {name}")
    return found


def is_public(module: str) -> bool:
    return module == "suta_calib" or module in PACKAGES


@pytest.mark.parametrize("package", ["suta_calib", *PACKAGES])
def test_the_tab_key_completes_what_is_public_and_nothing_else(package: str) -> None:
    module = import_module(package)
    names = {name for name in dir(module) if not name.startswith("__")}
    assert set(getattr(module, "__all__", ())) - {"__version__"} <= names
    if "__dir__" in vars(module):
        assert not names & {"Any", "TYPE_CHECKING", "annotations", "public"}


def source_of(path: Path) -> str:
    if path.suffix == ".py":
        return path.read_text(encoding="utf-8")
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    return "\n".join(re.sub(r"(?m)^[ \t]*[%!].*$", "", each) for each in code)


ROOT = Path(__file__).parents[1]
USERS = sorted([*ROOT.glob("notebooks/*.ipynb"), *ROOT.glob("benchmarks/*.py")])


@pytest.mark.parametrize("path", USERS, ids=lambda path: path.name)
def test_notebooks_and_benchmarks_use_public_names_only(path: Path) -> None:
    assert not inner(source_of(path))


@pytest.mark.parametrize("package", ["suta_calib", *PACKAGES])
def test_what_is_public_is_there_and_is_no_module(package: str) -> None:
    found = import_module(package)
    for name in getattr(found, "__all__", ()):
        # A module of the same name would take the name's place once it has been imported.
        offered = getattr(found, name)
        if isinstance(offered, ModuleType) and offered.__name__ == f"{package}.{name}":
            continue
        assert not isinstance(offered, ModuleType), f"{package}.{name}"
        submodule = Path(str(found.__file__)).parent / f"{name}.py"
        eager = name in vars(found)
        assert eager or not submodule.exists(), f"{package}.{name} is a module too"


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(AttributeError, match="No suta_calib attribute NoSuchName"):
        _ = suta_calib.NoSuchName  # type: ignore[attr-defined]


def test_a_module_of_the_package_needs_no_import_of_its_own() -> None:
    code = "import suta_calib; print(suta_calib.robots.__name__)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "suta_calib.robots"


def test_pages_use_public_names_only() -> None:
    blocks = [block for block in BLOCKS if block.language == "python"]
    assert blocks
    assert not [f"{block.page}: {line}" for block in blocks for line in inner(block.text)]


def test_inner_paths_are_seen() -> None:
    assert inner("from suta_calib.solver.solve import solve") != []
    assert inner("from suta_calib.analysis.outliers.search import find_outliers") != []
    assert inner("from suta_calib.terms import nothing_of_this_name") != []
    assert inner("from suta_calib import ArmModel, solve\nfrom suta_calib.units import mm") == []


# What a field may be of a dataclass that shows all of them.
PLAIN = re.compile(r"(float|int|str|bool|Path|Unit|Literal\[.*\]|\w*Kind)( \| None)?")


def test_every_public_object_is_short() -> None:
    """A dataclass that holds arrays, sequences or other objects says how large they are."""
    long = []
    for package in ("suta_calib", *PACKAGES):
        for name in getattr(import_module(package), "__all__", ()):
            each = getattr(import_module(package), name)
            # What a dataclass wrote is wrapped against recursion.
            if isinstance(each, type) and hasattr(each.__repr__, "__wrapped__"):
                long += [
                    f"{package}.{name}.{f.name}: {f.type}"
                    for f in fields(each)
                    if not PLAIN.fullmatch(str(f.type))
                ]
    assert long == []
