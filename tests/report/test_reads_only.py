"""What shows a calibration reads its examination: none of it solves or fits anything."""

from __future__ import annotations

import ast
import inspect
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import casadi
import pytest
import scipy.optimize
from report_scenes import make_job

from suta_calib.report.calibration import calibration_document
from suta_calib.report.files import write_document
from suta_calib.report.notebook import html_of
from suta_calib.solver import solve, weights
from suta_calib.solver.gauss_newton import GaussNewton
from suta_calib.solver.interface import Solver
from suta_calib.solver.ipopt import Ipopt
from suta_calib.trust import accuracy, calibration_examination
from suta_calib.view.calibration import calibration_scene

# What solves, or fits, or learns.
FUNCTIONS = (
    *(solve.solve, solve.solve_again, solve.solve_unjudged, accuracy.fit_own),
    *(weights.learn_weights, scipy.optimize.least_squares, scipy.optimize.minimize),
    casadi.nlpsol,
)
# Of what an examination calls: once for each term, and what only looks names up.
SEVERAL = {"touch_repeatability", "offered_beside", "known_beforehand"}
# Of solver/, what an answer consists of, and the threshold of a figure.
SHOWN = {"Estimate", "Identification", "Learned", "Minimum", "Solution", "State", "WEAK"}


def refuse_to_solve(patch: pytest.MonkeyPatch) -> None:
    """Replace everything that solves, wherever it was imported."""

    def solves(*_: Any, **__: Any) -> Any:
        raise AssertionError("showing an answer solves")

    names = ("suta_calib", "scipy.optimize", "casadi")
    for module in [m for name, m in sys.modules.items() if name.startswith(names)]:
        for name, value in list(vars(module).items()):
            if any(value is function for function in FUNCTIONS):
                patch.setattr(module, name, solves)
    for method in ("minimise", "minimise_all"):
        for solver in (Solver, GaussNewton, Ipopt):
            patch.setattr(solver, method, solves)


@pytest.mark.parametrize("iterations", [200, 1], ids=["converged", "stopped"])
def test_whatever_shows_a_calibration_solves_nothing(
    iterations: int, tmp_path: Path, suta_urdf: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = make_job(tmp_path, suta_urdf, iterations=iterations).run()
    assert result.solution.converged == (iterations > 1)
    refuse_to_solve(monkeypatch)
    document = calibration_document(result)
    written = write_document(document, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert document.assessment is result.assessment
    assert written["verdict"] == result.assessment.as_dict()
    assert "fault of suta_calib" not in page + html_of(result)
    assert calibration_scene(result.calibrated).rows.q.size


def test_each_quantity_is_computed_once(
    tmp_path: Path, suta_urdf: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts = Counter[str]()

    def counted(name: str, function: Any) -> Any:
        def count(*args: Any, **settings: Any) -> Any:
            counts[name] += 1
            return function(*args, **settings)

        return count

    functions = {
        name: function
        for name, function in vars(calibration_examination).items()
        if inspect.isfunction(function) and function.__module__.startswith("suta_calib")
    }
    for name in functions.keys() - SEVERAL:
        monkeypatch.setattr(calibration_examination, name, counted(name, functions[name]))
    result = make_job(tmp_path, suta_urdf).run()
    write_document(calibration_document(result), tmp_path / "out")
    assert calibration_scene(result.calibrated).rows.q.size
    assert result.solution.widening == 1.0
    assert set(counts.values()) == {1}, counts
    assert len(counts) >= 10


def test_reports_import_nothing_that_solves(repository: Path) -> None:
    for file in sorted((repository / "suta_calib" / "report").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith(
                "suta_calib.solver"
            ):
                assert {alias.name for alias in node.names} <= SHOWN, file
            if isinstance(node, ast.ImportFrom) and str(node.module).endswith("accuracy"):
                assert {alias.name for alias in node.names}.isdisjoint({"assess", "fit_own"}), file
