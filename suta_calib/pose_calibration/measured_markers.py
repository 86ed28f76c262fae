"""Markers as a fit placed them: a board with standard deviations, and what denies stated sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import tangent_of_poses
from suta_calib.measurements.board import Markers
from suta_calib.measurements.scale import INSTRUMENT_PPM, PPM, LengthScale
from suta_calib.model.parameters import PLACEMENT
from suta_calib.solver.solution import Solution
from suta_calib.terms import CameraView
from suta_calib.terms.surveyed_markers import SurveyedMarkers, marker_owner


def measured_markers(
    term: CameraView, names: Sequence[str], x: FloatArray, covariance: FloatArray
) -> Markers | None:
    """The board of a term with its markers where a fit has them; None of another board.

    Its scale is as well known as what all its estimated lengths have in common.

    Args:
        term: that was fitted.
        names: of the parameters.
        x: (n,) their values, SI.
        covariance: (n, n) of them.
    """
    board = term.board
    if not isinstance(board, SurveyedMarkers):
        return None
    index = {name: k for k, name in enumerate(names)}
    measured_board = board.at(term.sees_board, dict(zip(names, x.tolist(), strict=True)))
    markers = dict(measured_board.markers)
    lengths: list[int] = []
    for number in board.estimated:
        owner, marker = marker_owner(number, term.sees_board), markers[number]
        shift, turn, std = np.zeros(3), np.zeros(3), 0.0
        if number in board.sized:
            size = index[f"{owner}.size"]
            lengths.append(size)
            std = float(np.sqrt(max(covariance[size, size], 0.0)))
        if number != board.anchor:
            at = [index[f"{owner}.{key}"] for key in PLACEMENT]
            lengths += at[:3]
            tangent = tangent_of_poses(x[at])
            variance = np.diag(tangent @ covariance[np.ix_(at, at)] @ tangent.T)
            shift, turn = np.split(np.sqrt(np.maximum(variance, 0.0)), 2)
        markers[number] = replace(marker, position_std=shift, rotation_std=turn, size_std=std)
    scale = board.length_scale
    if not board.carries_scale:
        v, C = x[lengths], covariance[np.ix_(lengths, lengths)]
        unit = np.sqrt(np.maximum(np.diag(C), 1e-300))
        inverse = np.linalg.pinv(C / np.outer(unit, unit), 1e-12, hermitian=True)
        precision = float((v / unit) @ inverse @ (v / unit))
        scale = LengthScale(max(precision**-0.5 if precision > 0 else 1.0, INSTRUMENT_PPM * PPM))
    return Markers(board.dictionary, markers, scale=scale)


def measured_boards(solution: Solution) -> dict[str, Markers]:
    """Boards whose markers nobody had measured, as a solution has them, by label."""
    boards: dict[str, Markers] = {}
    for term in solution.problem.terms:
        if isinstance(term, CameraView) and isinstance(term.board, SurveyedMarkers):
            scaled = term.board.carries_scale
            covariance = solution.covariance_within_scale if scaled else solution.covariance
            board = measured_markers(term, solution.problem.names, solution.x, covariance)
            assert board is not None
            boards.setdefault(term.target, board)
    return boards


def against_stated_sizes(term: CameraView, measured: Markers | None) -> str:
    """That markers are larger or smaller than their file says, all in all; empty if not."""
    if measured is None or not isinstance(term.board, SurveyedMarkers) or not term.board.stated:
        return ""
    ratios, stds = [], []
    for number, size in term.board.stated.items():
        marker = measured.markers[number]
        ratios.append(marker.size / size)
        stds.append((marker.size_std or 0.0) / size)
    ratio = float(np.mean(ratios))
    std = float(np.hypot(np.mean(stds), measured.length_scale.std))
    # Errors of an arm's lengths are smaller; and chance explains three standard deviations.
    if abs(ratio - 1.0) < max(0.01, 3.0 * std):
        return ""
    return (
        f"By the motions of the hand the markers are {ratio:.3f} ± {std:.3f} times as large as "
        "size_mm says. Measure the edges of their black squares, and check the scale of the "
        "hand's positions."
    )
