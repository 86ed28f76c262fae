"""Printed bodies: how much longer they are along x and along y is estimated, with a prior."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated import PLAIN
from sound_sets import BOARD, SHEET, SUTA, SUTA_UNKNOWN, TRUTH, UNKNOWN, of_scene, sheet_scene

from suta_calib import Problem, Selection, SolverOptions, solve
from suta_calib.errors import ArtefactError
from suta_calib.measurements.artefact import Artefact, artefact_text, read_artefact
from suta_calib.measurements.board import board_text, read_board
from suta_calib.terms import Term
from suta_calib.trust.hypotheses.stretch import stretched

PRIOR = 0.005


def free(term: Term) -> Term:
    """The term with the stretch of its artefact or board estimated."""
    key = "artefact" if term.touched is not None else "board"
    body = replace(getattr(term, key), stretch=PRIOR)
    return replace(term, **{key: body})


@pytest.mark.parametrize("kind", ["landmark", "pairwise_distance"])
def test_exact_touches_of_a_stretched_sheet_tell_both_stretches(kind: str) -> None:
    """The arm's lengths are held at the truth: then x and y are determined each by itself."""
    scene = sheet_scene(kind)
    offsets = SUTA.select(Selection("*.offset", bound_rad=0.26))
    lengths = {name: value for name, value in scene.truth.items() if name not in offsets}
    held = SUTA.at(lengths)
    exact = replace(scene, arm=held).exact(PLAIN)
    term = stretched(free(exact), (1 / 1.006, 1 / 0.997))
    solution = solve(Problem([term], held.select(Selection("*.offset", bound_rad=0.26))))
    assert solution.converged
    assert solution.values["stretch[sheet].x"] == pytest.approx(0.006, abs=3e-6)
    assert solution.values["stretch[sheet].y"] == pytest.approx(-0.003, abs=3e-6)


def test_a_board_tells_by_how_much_x_is_longer_than_y() -> None:
    """Where the lengths of the arm are free they take up the rest, and each ± says so."""
    for longer in (1.0, 1.012):
        term = stretched(free(BOARD.make(1)), (1 / longer, 1.0))
        solution = solve(Problem([term], UNKNOWN), SolverOptions(starts=1, confirm=False))
        at = [solution.problem.names.index(f"stretch[target].{axis}") for axis in "xy"]
        x, y = solution.x[at]
        covariance = solution.covariance[np.ix_(at, at)]
        along = np.array([1.0, -1.0])
        assert abs(x - y - (longer - 1.0)) < 3 * np.sqrt(along @ covariance @ along)
        assert np.sqrt(covariance[0, 0]) > 0.3 * PRIOR
        assert set(TRUTH) <= set(solution.values)


def test_a_stretched_sheet_costs_nothing_once_it_is_estimated() -> None:
    """The stretch of the file changes the estimate of the stretch, and nothing else."""
    found = []
    for longer in (1.0, 1.012):
        term = stretched(free(SHEET.make(1)), (1 / longer, 1.0))
        problem = Problem([term], SUTA_UNKNOWN)
        solution = solve(problem, SolverOptions(starts=1, confirm=False))
        found.append({n: v for n, v in solution.values.items() if not n.startswith("stretch")})
    for name, value in found[0].items():
        assert found[1][name] == pytest.approx(value, abs=2e-4), name


def test_two_terms_over_one_sheet_share_its_stretch() -> None:
    terms = [
        free(of_scene(sheet_scene(kind)).make(1)) for kind in ("landmark", "pairwise_distance")
    ]
    names = [n for n in Problem(terms, SUTA_UNKNOWN).names if n.startswith("stretch")]
    assert names == ["stretch[sheet].x", "stretch[sheet].y"]


ARTEFACT = (
    "name: sheet\n{more}landmarks:\n"
    "  A: {{position_mm: [0, 0, 0]}}\n  B: {{position_mm: [90, 0, 0]}}\n"
)
BOARD_FILE = "type: chessboard\ncorners: [7, 5]\nsquare_mm: 30\n{more}"
KEYS = [
    ("", None),
    # A grade is that of the mean of both sides; a stated scale is that of each.
    ("grade: printed\n", math.sqrt(2) * 0.005),
    ("grade: printed\nscale_ppm: 2000\n", 0.002),
    ("grade: printed\nstretch: fixed\n", None),
    ("grade: certified\n", None),
    ("stretch: free\n", math.sqrt(2) * 0.005),
]


@pytest.mark.parametrize(("more", "prior"), KEYS)
def test_files_say_it_by_grade_or_by_key_and_are_written_back(
    more: str, prior: float | None, tmp_path: Path
) -> None:
    file = tmp_path / "artefact.yaml"
    file.write_text(ARTEFACT.format(more=more))
    artefact: Artefact = read_artefact(file)
    assert artefact.stretch == prior
    file.write_text(artefact_text(artefact))
    assert read_artefact(file).stretch == prior
    file.write_text(BOARD_FILE.format(more=more))
    board = read_board(file)
    assert board.stretch == prior
    file.write_text(board_text(board))
    assert read_board(file).stretch == prior


def test_another_word_is_refused_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "artefact.yaml"
    file.write_text(ARTEFACT.format(more="stretch: some\n"))
    with pytest.raises(ArtefactError, match=re.escape("artefact.yaml:2: stretch: found 'some'")):
        read_artefact(file)
