"""A module imports only from rows at or above its own, so that data flow one way."""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

ROWS = (
    {
        "errors",
        "arguments",
        "arrays",
        "units",
        "assessment",
        "atomic",
        "sandbox",
        "optional_packages",
    }
    | {"inputs", "registry"}
    | {"display", "processes", "threads", "words"},
    {"geometry", "batched", "plotting"},
    {"model", "measurements"},
    {"terms", "robots"},
    {"arm_additions", "arm_keys"},
    {"solver"},
    {"simulation"},
    {"trust"},
    {"view"},
    {"job"},
    {"pose_calibration"},
    {"stereotactic", "analysis", "certification", "vision"},
    {"device"},
    {"emulation", "acquisition", "tracking"},
    {"check"},
    {"exchange"},
    {"certificate"},
    {"report"},
    {"guide", "demo", "fleet"},
    {"cli", "api", "__init__", "__main__"},
)
ROW = {part: row for row, parts in enumerate(ROWS) for part in parts}
# Parts that see less than their row would allow them.
ONLY = {
    "model": {"model"} | ROWS[0] | ROWS[1],
    "measurements": {"measurements"} | ROWS[0] | ROWS[1],
    "device": {"device", "measurements"} | ROWS[0] | ROWS[1],
    "vision": {"vision", "terms", "measurements"} | ROWS[0] | ROWS[1],
}


def imported_parts(source: str, package: tuple[str, ...]) -> set[str]:
    """Parts of suta_calib that ``source``, a module in ``package``, imports."""
    modules: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join((*above, *filter(None, [node.module])))
            modules += [f"{module}.{alias.name}" for alias in node.names]
    names = (module.split(".") for module in modules)
    return {path[1] if path[1:] else "__init__" for path in names if path[0] == "suta_calib"}


def violations(part: str, imported: set[str]) -> set[str]:
    """Which of the ``imported`` parts ``part`` must not see; a name of no part is the root's."""
    parts = {name if name in ROW else "__init__" for name in imported}
    return {name for name in parts if ROW[name] > ROW[part] or name not in ONLY.get(part, ROW)}


def test_every_module_imports_only_from_rows_above(repository: Path) -> None:
    found = []
    for file in sorted((repository / "suta_calib").rglob("*.py")):
        path = file.relative_to(repository).with_suffix("").parts
        assert path[1] in ROW, f"{file}: give suta_calib.{path[1]} a row in ROWS"
        wrong = violations(path[1], imported_parts(file.read_text(encoding="utf-8"), path[:-1]))
        found += [f"{'.'.join(path)} imports {name}" for name in sorted(wrong)]
    assert not found, "\n".join(found)


def test_imports_are_seen_however_they_are_written() -> None:
    source = (
        "import numpy, suta_calib.job.calibration\n"
        "from suta_calib import terms\n"
        "from suta_calib.solver.solve import solve\n"
        "from .arm import Arm\n"
        "from .. import report\n"
        "def late():\n"
        "    from ..analysis import outliers\n"
    )
    seen = imported_parts(source, ("suta_calib", "model"))
    assert seen == {"job", "terms", "solver", "model", "report", "analysis"}


def test_a_process_that_only_reads_a_port_loads_no_mathematics() -> None:
    # It is started for each device and must be there before the first frame.
    code = (
        "import sys, suta_calib.device.port_process, suta_calib.emulation.emulated_arm\n"
        "print(*sorted({'casadi', 'pinocchio'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not run.stdout.split()


def test_only_planning_loads_the_distributions_of_scipy(repository: Path) -> None:
    # They take half a second to import; `scipy.special` has the functions.
    files = (repository / "suta_calib").rglob("*.py")
    imports = [
        file.name
        for file in sorted(files)
        for line in file.read_text(encoding="utf-8").splitlines()
        if line.split()[:1] in (["from"], ["import"]) and "scipy" in line and "stats" in line
    ]
    assert imports == ["region.py"]


def modules(package: Path) -> dict[str, Path]:
    """Every module of a package by its full name."""
    return {
        ".".join(file.relative_to(package.parent).with_suffix("").parts): file
        for file in package.rglob("*.py")
    }


def imports_of(package: Path) -> dict[str, set[str]]:
    """Modules of the package that each module imports, also those only for the type checker."""
    files = modules(package)
    names = {name.removesuffix(".__init__"): name for name in files}
    found: dict[str, set[str]] = {}
    for name, file in files.items():
        wanted: set[str] = set()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                wanted |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                inner = {f"{node.module}.{alias.name}" for alias in node.names}
                wanted |= (inner & names.keys()) or {node.module}
        found[name] = {names[module] for module in wanted & names.keys()} - {name}
    return found


def test_nothing_imports_in_a_circle(repository: Path) -> None:
    graph = imports_of(repository / "suta_calib")
    # What a package's __init__ offers by name is imported when it is used: no part of a circle.
    lazy = {
        name for name, file in modules(repository / "suta_calib").items() if lazily_public(file)
    }
    direct = {name: wanted - lazy for name, wanted in graph.items() if name not in lazy}
    TopologicalSorter(direct).prepare()  # a CycleError names the circle


def lazily_public(file: Path) -> bool:
    """Whether a package's ``__init__`` imports its names when they are first used."""
    return file.name == "__init__.py" and "__getattr__" in file.read_text(encoding="utf-8")


def test_a_wrong_direction_is_refused() -> None:
    assert violations("model", {"errors", "measurements", "terms"}) == {"measurements", "terms"}
    assert violations("simulation", {"solver", "analysis"}) == {"analysis"}
    assert violations("device", {"measurements", "report"}) == {"report"}
    assert violations("terms", {"Problem"}) == {"__init__"}
    assert violations("cli", {"job", "report", "Problem"}) == set()
