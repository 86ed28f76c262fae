"""A module imports only from rows at or above its own, so that data flow one way."""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from suta_calib.lazy import UNUSED_OF_NUMPY

ROWS = (
    {"errors", "arrays", "units", "assessment", "atomic", "confined", "distributions", "extras"}
    | {"halton", "incomplete", "inputs", "lazy"}
    | {"processes", "records", "registry", "showing", "staging", "threads", "words"},
    {"geometry", "batched", "elementwise", "plotting"},
    {"model", "measurements"},
    {"terms", "robots"},
    {"solver"},
    {"simulation"},
    {"trust", "diagnostics"},
    {"view"},
    {"job"},
    {"pose_calibration"},
    {"stereotactic", "analysis", "certification", "vision"},
    {"device"},
    {"emulation", "acquisition", "tracking"},
    {"exchange"},
    {"report"},
    {"cli", "__init__", "__main__"},
)
ROW = {part: row for row, parts in enumerate(ROWS) for part in parts}
# Parts that see less than their row would allow them.
ONLY = {
    "model": {"model"} | ROWS[0] | ROWS[1],
    "measurements": {"measurements"} | ROWS[0] | ROWS[1],
    "device": {"device", "measurements"} | ROWS[0] | ROWS[1],
    "vision": {"vision", "measurements"} | ROWS[0] | ROWS[1],
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


@pytest.mark.parametrize(
    ("modules", "heavy"),
    [
        ("units, assessment, errors, arrays", ("casadi", "scipy", "pinocchio", "yaml")),
        ("device, device.bus, device.description", ("casadi", "scipy", "pinocchio")),
        ("measurements.samples, measurements.sample_files", ("casadi", "scipy", "pinocchio")),
        ("measurements.artefact, measurements.yaml_file", ("casadi", "scipy", "pinocchio")),
        ("geometry.numbers, model.parameters", ("casadi", "scipy", "pinocchio")),
        ("emulation.child, device.port_process", ("casadi", "scipy", "pinocchio")),
        (
            "job.calibration, pose_calibration.pivot, report.observability, report.calibration, "
            "report.pivot, report.hand_eye, report.registration",
            ("matplotlib", "scipy.stats", "scipy.optimize", "scipy.interpolate", "cv2"),
        ),
        ("cli._app", ("casadi", "scipy", "pinocchio", "numpy", "matplotlib")),
    ],
)
def test_what_needs_no_mathematics_does_not_wait_for_it(
    modules: str, heavy: tuple[str, ...]
) -> None:
    # Old namespace packages are there from the start, by a .pth file.
    code = "import sys\nbefore = set(sys.modules)\n"
    code += "".join(f"import suta_calib.{name.strip()}\n" for name in modules.split(","))
    code += f"print(*sorted(set({heavy!r}) & set(sys.modules) - before))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not run.stdout.split()


# What each command has no use for of other people's packages.
JOB = "data/suta/calibration.yaml"
NO_ARM = ("jinja2", "pinocchio", "lxml")
ARM = ("jinja2",)
STARTUP: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "--help": ((), ("numpy",)),
    "calibrate": ((JOB,), ARM[1:]),
    "observe": ((JOB,), ARM),
    "validate": (("urdf/suta.urdf", JOB), ARM),
    "outliers --out": ((JOB,), ()),
    "pivot": (("data/poses/pivot.csv",), ("json", *NO_ARM)),
    "hand-eye": (("data/poses/hand_eye.csv",), ("json", *NO_ARM)),
    "register": (("data/poses/register_a.csv", "data/poses/register_b.csv"), ("json", *NO_ARM)),
    "pivot --out": (("data/poses/pivot.csv",), NO_ARM[1:]),
    "hand-eye --out": (("data/poses/hand_eye.csv",), NO_ARM[1:]),
    "register --out": (("data/poses/register_a.csv", "data/poses/register_b.csv"), NO_ARM[1:]),
}
# To draw, to sample and minimise, to see, to listen, to compute elsewhere, to guess what a wrong
# word means; what SciPy would load of NumPy, if nobody were there before it.
UNUSED = (
    *("matplotlib", "PIL", "scipy.stats", "scipy.optimize", "scipy.interpolate", "scipy.spatial"),
    *("cv2", "viser", "serial", "anycrc", "pyigtl", "joblib", "distributed", "pyarrow", "asyncio"),
    *("difflib", "numpy.f2py.f2py2e"),
)


@pytest.mark.parametrize("command", STARTUP)
def test_a_command_loads_no_package_that_it_does_not_use(
    command: str, repository: Path, tmp_path: Path
) -> None:
    arguments, unused = STARTUP[command]
    writes = command == "calibrate" or command.endswith("--out")
    code = (
        "import sys; before = set(sys.modules)\n"
        "from suta_calib.cli import run\n"
        "code = run(sys.argv[1:])\n"
        "print(code, *sorted(set(sys.modules) - before), file=sys.stderr)"
    )
    out = ("--out", str(tmp_path)) if writes else ()
    line = [sys.executable, "-c", code, *command.split()[:1], *arguments, *out]
    run = subprocess.run(line, cwd=repository, capture_output=True, text=True, check=True)
    exit_code, *loaded = run.stderr.splitlines()[-1].split()
    assert exit_code == "0", run.stderr
    assert not {*UNUSED, *unused} & set(loaded)


def test_what_is_spared_is_there_when_it_is_used() -> None:
    code = (
        "import sys, numpy\n"
        "from suta_calib.lazy import UNUSED_OF_NUMPY, spare\n"
        "spare('numpy', UNUSED_OF_NUMPY)\n"
        "import scipy.special\n"
        "assert 'numpy.f2py.f2py2e' not in sys.modules\n"
        "from numpy.testing import assert_allclose\n"
        "import numpy.polynomial\n"
        "assert_allclose(numpy.polynomial.Polynomial([1.0, 2.0])(3.0), 7.0)\n"
        "assert numpy.ma.masked_invalid([1.0, float('nan')]).count() == 1\n"
        "print(*(isinstance(getattr(numpy, name), type(sys)) for name in UNUSED_OF_NUMPY))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["True"] * len(UNUSED_OF_NUMPY)


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
