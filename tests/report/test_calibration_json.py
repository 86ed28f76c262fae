"""The result as JSON, and the tables of residuals and errors."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from report_scenes import AWKWARD, TRUTH, console_text, with_accuracy

from suta_calib.job.calibration import Calibration
from suta_calib.report.calibration import calibration_document
from suta_calib.report.console import rendered
from suta_calib.report.errors import RESIDUALS, accuracy_json, by_kind, groups, residual_rows
from suta_calib.report.listing import Json, csv_of_groups
from suta_calib.report.page import page_with


def result_dict(result: Calibration) -> Json:
    return calibration_document(result).json()


# result.json


def test_json_has_what_the_format_promises(result: Calibration) -> None:
    content = json.loads(json.dumps(result_dict(result), allow_nan=False))
    assert content["status"] == "converged"
    assert content["verdict"]["sentence"] == result.solution.sentence
    assert content["verdict"] == result.assessment.as_dict()
    assert content["job"] == "calibration.yaml"
    assert {"build", "solve"} <= set(content["timing_s"])
    assert {"suta_calib", "pin", "casadi", "numpy", "python"} <= set(content["versions"])
    for part in content["metrics"].values():
        for state in ("before", "after"):
            assert set(part[state]) == {"rms_mm", "mean_mm", "std_mm", "max_mm", "count"}
    kinds = [row["kind"] for row in content["metrics"]["calibration"]["by_term"]]
    assert kinds == ["tracked_point", "fixed_point"]
    assert content["metrics"]["calibration"]["by_term"][0]["label"] == "rig"
    assert len(content["solver"]["starts"]) == 2
    assert [n["given"] for n in content["noise"]] == [True, False]
    for row in content["noise"]:
        assert row["interval"][0] < row["found"] < row["interval"][1]
    (prior,) = content["priors"]
    assert prior["group"] == "lengths"
    assert prior["interval"][0] < prior["factor"] < prior["interval"][1]


def test_json_values_are_the_solution_in_si(result: Calibration) -> None:
    content = result_dict(result)["parameters"]
    assert list(content) == list(result.solution.problem.names)
    for name, estimate in result.solution.estimates.items():
        assert content[name]["value"] == estimate.value
        assert content[name]["std"] == estimate.std
        assert content[name].get("given", []) == list(estimate.given)
    z = content["joint_4.z"]
    assert (z["unit"], z["nominal"], z["state"]) == ("m", 0.571, "identified")
    assert abs(z["value"] - TRUTH["joint_4.z"]) < 4 * z["std"]
    assert z["bounds"] == pytest.approx([0.541, 0.601])
    assert content["joint_6.z"]["prior"] == pytest.approx(1e-6)


def test_json_has_the_poses_of_what_stands_outside_the_arm(result: Calibration) -> None:
    found = result_dict(result)["external_poses"]
    parameters = result.solution.estimates
    assert list(found) == ["base[rig]", f"fixed_point[{AWKWARD}]", "fixed_point[F2]"]
    base, point = found["base[rig]"], found["fixed_point[F2]"]
    assert (base["what"], base["within"]) == ("base", "instrument")
    assert np.array(base["matrix"])[:3, 3].tolist() == [
        parameters[f"base[rig].{key}"].value for key in "xyz"
    ]
    np.testing.assert_allclose(np.array(base["matrix"]) @ base["inverse"], np.eye(4), atol=1e-12)
    assert base["position_mm"] == pytest.approx([300, -200, 100], abs=1)
    assert base["position_std_mm"] == pytest.approx(
        [1e3 * (parameters[f"base[rig].{key}"].std or np.nan) for key in "xyz"]
    )
    assert base["rpy_deg"] == pytest.approx([0, 0, 90], abs=0.5)
    assert base["quaternion_xyzw"] == pytest.approx([0, 0, 0.5**0.5, 0.5**0.5], abs=0.01)
    assert len(base["rotation_std_deg"]), len(base["quaternion_std"]) == (3, 4)
    assert (point["matrix"], point["quaternion_xyzw"]) == (None, None)
    assert point["rotation_std_deg"] == [None] * 3


def test_json_states_follow_the_rules(result: Calibration) -> None:
    content = result_dict(result)
    parameters = content["parameters"]
    assert parameters["joint_6.z"]["state"] == "prior"
    assert parameters["joint_5.z"]["state"] == "fixed"
    # The unknown pose of the instrument makes up for a turn of the first joint.
    assert "joint_1.offset" in content["unidentified"]
    for name, p in parameters.items():
        assert (p["std"] is not None) == (p["state"] in ("identified", "prior")), name
        assert (name in content["unidentified"]) == (p["state"] == "unidentified")
        if p["state"] in ("unidentified", "fixed"):
            assert p["value"] == p["nominal"]


def test_json_tells_held_out_errors_from_their_prediction(result: Calibration) -> None:
    (row,) = result_dict(result)["held_out"]
    assert (row["kind"], row["label"], row["block"], row["unit"]) == (
        "tracked_point",
        "rig",
        "position",
        "m",
    )
    assert 0.5 < row["std"] / row["predicted_std"] < 1.5
    assert row["parameters_std"] < row["predicted_std"]
    assert len(row["each_predicted_std"]) == 15
    assert 40 <= row["within_68_pct"] <= row["within_95_pct"] <= 100
    shown = console_text(rendered(calibration_document(result), verbose=True))
    assert "within 68 %" in shown


def test_json_metrics_are_those_of_the_first_kind_in_mm(result: Calibration) -> None:
    errors = result.accuracy.validation[0].blocks[0].after
    after = result_dict(result)["metrics"]["validation"]["after"]
    assert after["rms_mm"] == pytest.approx(1e3 * math.sqrt(np.mean(errors**2)))
    assert after["max_mm"] == pytest.approx(1e3 * errors.max())
    assert after["count"] == 15
    # Noise of 0.2 mm per axis, and the truth within reach.
    assert 0.2 < after["rms_mm"] < 0.6


def test_json_adds_one_figure_for_orientations(result: Calibration) -> None:
    term = result.accuracy.validation[0]
    turned = np.full((3, 1), math.radians(2.0))
    rotation = replace(
        term.blocks[0],
        name="rotation",
        unit="rad",
        labels=("a", "b", "c"),
        rows=np.arange(3)[:, None],
        residual_before=turned,
        residual_after=turned / 4,
    )
    found = accuracy_json([replace(term, blocks=(*term.blocks, rotation))])
    assert found["before"]["rms_deg"] == pytest.approx(2.0)
    assert found["after"]["rms_deg"] == pytest.approx(0.5)
    assert found["after"]["count"] == 15
    assert set(found["after"]) == {"rms_mm", "mean_mm", "std_mm", "max_mm", "count", "rms_deg"}


def test_json_lists_only_real_combinations(result: Calibration) -> None:
    for direction in result_dict(result)["unobservable"]:
        assert len(direction) >= 2
        assert set(direction) <= set(result.solution.problem.names)


def test_json_correlations_are_of_the_estimated_arm_parameters(result: Calibration) -> None:
    found = result_dict(result)["correlations"]
    matrix = np.array(found["matrix"])
    states = {n: result.solution.estimates[n].state for n in found["parameters"]}
    assert not [n for n in states if n.startswith(("base", "fixed_point"))]
    assert set(states.values()) <= {"identified", "prior"}
    np.testing.assert_allclose(np.diag(matrix), 1.0)
    np.testing.assert_allclose(matrix, matrix.T)


def test_unconverged_json_carries_no_values(unconverged: Calibration) -> None:
    content = json.loads(json.dumps(result_dict(unconverged), allow_nan=False))
    assert content["status"] == "not_converged"
    for p in content["parameters"].values():
        assert (p["value"], p["std"], p["state"]) == (None, None, "not_converged")
    for part in content["metrics"].values():
        assert part["before"]["rms_mm"] > 0
        assert part["after"]["rms_mm"] is None


def test_json_without_validation_has_nulls_not_nan(result: Calibration) -> None:
    job = replace(result.job, spec=replace(result.job.spec, validation=()))
    alone = with_accuracy(replace(result, job=job), replace(result.accuracy, validation=()))
    part = json.loads(json.dumps(result_dict(alone), allow_nan=False))["metrics"]["validation"]
    assert part["after"] == {**dict.fromkeys(("rms_mm", "mean_mm", "std_mm", "max_mm")), "count": 0}
    assert "no validation data" in " ".join(alone.assessment.notes)
    document = calibration_document(alone)
    assert "no such data" in console_text(rendered(document, verbose=True))
    page_with(document, None)


# residuals.csv


def test_residuals_are_all_there_and_add_up(result: Calibration) -> None:
    text = csv_of_groups(RESIDUALS, residual_rows(result.labelled_terms))
    rows = list(csv.DictReader(io.StringIO(text)))
    assert len(rows) == 40 + 12 + 15
    assert list(rows[0]) == [column.key for column in RESIDUALS.columns]
    assert rows[0]["samples"].endswith("calibration.csv:2")
    assert {r["label"] for r in rows if r["kind"] == "tracked_point"} == {"rig"}
    assert AWKWARD in {r["what"] for r in rows}
    held_out = [float(r["error_after"]) for r in rows if r["set"] == "validation"]
    wanted = 1e3 * result.accuracy.validation[0].blocks[0].after
    np.testing.assert_allclose(held_out, wanted, rtol=1e-5)
    for row in rows:
        components = [float(row[f"c{k}_after"]) for k in (1, 2, 3)]
        assert math.hypot(*components) == pytest.approx(float(row["error_after"]), rel=1e-4)


# grouping and judging


def test_errors_are_grouped_by_label(result: Calibration) -> None:
    found = groups(result.accuracy.calibration, "point")
    assert {name: len(e) for name, e in found.items()} == {AWKWARD: 6, "F2": 6}
    assert set(groups(result.accuracy.validation, "file")) == {"validation.csv"}
    assert [e.kind for e in by_kind(result.accuracy.calibration)] == [
        "tracked_point",
        "fixed_point",
    ]


def test_an_error_counts_once_for_each_label_of_its_ends(result: Calibration) -> None:
    _, term = result.accuracy.calibration
    names = term.term.poses.samples.labels["point"]
    rows = np.array([[j, k] for j in range(len(names)) for k in range(j)])
    off = np.arange(1.0, 1.0 + len(rows))[:, None]
    block = replace(term.blocks[0], labels=(), rows=rows, residual_before=off, residual_after=off)
    found = groups([replace(term, blocks=(block,))], "point")
    assert list(found) == list(dict.fromkeys(names.tolist()))
    for name, errors in found.items():
        np.testing.assert_array_equal(errors, off[(names[rows] == name).any(axis=1), 0])
