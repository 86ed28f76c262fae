"""Who knows the kinds of observation: `suta_calib.terms`, and nobody else."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from suta_calib.registry import shipped
from suta_calib.terms import KINDS, Term, first_kind

# Files that state a problem of their own over measured poses, or offer the classes: what they use.
BY_NAME = {
    "__init__.py": {"FixedPoint", "HandEye", "PairwiseDistance", "TouchedLandmark", "TrackedPoint"},
    "check/pose_answers.py": {"FixedPoint", "HandEye", "TrackedPoint"},
    "pose_calibration/measured_markers.py": {"CameraView"},
    "pose_calibration/picture_causes.py": {"CameraView"},
    "pose_calibration/picture_models.py": {"CameraView"},
    "pose_calibration/picture_noise.py": {"CameraView"},
    "pose_calibration/picture_proof.py": {"CameraView"},
    "pose_calibration/picture_rows.py": {"CameraView"},
    "pose_calibration/pictures.py": {"CameraView"},
    "pose_calibration/pivot.py": {"FixedPoint"},
    "pose_calibration/proof.py": {"FixedPoint", "HandEye", "TrackedPoint"},
    "pose_calibration/rigid_fit.py": {"TrackedPoint"},
    "pose_calibration/robot_noise.py": {"HandEye"},
    "pose_calibration/stated_noise.py": {"TrackedPoint"},
    "trust/hypotheses/bent_tip.py": {"FixedPoint"},
    "trust/hypotheses/depth_scale.py": {"HandEye"},
    "trust/hypotheses/moved_at_a_row.py": {"FixedPoint", "HandEye", "TrackedPoint"},
    "trust/hypotheses/scaled_points.py": {"TrackedPoint"},
    "trust/hypotheses/strained_points.py": {"TrackedPoint"},
    "trust/hypotheses/transposed_rotations.py": {"HandEye"},
}
# Kinds that are called like something else too: a label column, a figure of a report.
SHIPPED = shipped(KINDS)
COLUMNS = {column for kind in SHIPPED.values() for column in kind.columns.labels}
# Kinds that are called like any word of a sentence: there only a literal of its own names one.
WORDS = {"contact", "gravity", "profile", "range"}
# A word so plain that no literal tells what it names: the class alone does.
PLAIN = {"points"}
# What else is called like a kind: a command's module, its pictures, a table that is shipped, a key
# of a summary, an attribute of MJCF, the direction of gravity.
OTHERS = {
    # An element of the Digital Calibration Certificate.
    "certificate/dcc.py": {"contact"},
    "cli/_app.py": {"suta_calib.cli.hand_eye"},
    "demo/__init__.py": {"data/poses/hand_eye.csv"},
    "exchange/mjcf_child.py": {"range"},
    "exchange/readers/mjcf.py": {"range"},
    "exchange/writers/mjcf.py": {"range"},
    "measurements/fields.py": {"gravity"},
    "model/arm.py": {"gravity"},
    "report/hand_eye.py": {"hand_eye"},
    "report/line_scanner.py": {"hand_eye"},
    "report/pose_plots.py": {"hand_eye"},
    "report/study.py": {"range"},
}

each_kind = pytest.mark.parametrize("kind", SHIPPED.values(), ids=SHIPPED)


def literals(nodes: Sequence[ast.AST]) -> Iterator[str]:
    """Text in the code, docstrings apart."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in nodes
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    for node in nodes:
        if isinstance(node, ast.Constant) and id(node) not in docstrings:
            yield str(node.value)


def test_no_file_outside_terms_names_a_kind(repository: Path) -> None:
    package = repository / "suta_calib"
    names = re.compile(
        rf"\b({'|'.join(sorted(SHIPPED.keys() - COLUMNS - WORDS - PLAIN))})\b|^({'|'.join(WORDS)})$"
    )
    classes = {kind.__name__ for kind in SHIPPED.values()}
    found = []
    for file in sorted(package.rglob("*.py")):
        place = file.relative_to(package).as_posix()
        if place.startswith("terms/"):
            continue
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        used = {node.id for node in nodes if isinstance(node, ast.Name)}
        used |= {a.name for n in nodes if isinstance(n, ast.ImportFrom) for a in n.names}
        found += [f"{place}: {name}" for name in sorted(used & classes - BY_NAME.get(place, set()))]
        named = {text for text in literals(nodes) if names.search(text)}
        found += [f"{place}: {text!r}" for text in sorted(named - OTHERS.get(place, set()))]
    assert not found, "\n".join(found)


@each_kind
def test_a_kind_is_described(kind: type[Term]) -> None:
    assert kind.about
    assert not kind.about.endswith(".")
    assert kind.medium in ("touch", "instrument", "camera")
    assert bool(kind.place) == bool(kind.place_unknown) == (kind.medium == "touch")
    columns = (*kind.columns.labels, *kind.columns.common_labels)
    assert not kind.place or kind.place in columns
    for noun, columns in kind.groupings.items():
        assert set(columns) <= {*kind.columns.labels, *kind.columns.common_labels}, noun
    assert not kind.mark or kind.mark in kind.columns.common_labels
    # What is seen is a position, or in pictures or profiles.
    lengths = kind.medium != "touch" and kind.unit == "mm" and not kind.columns.pixels
    assert kind.columns.position == lengths


def test_the_first_of_each_sort_is_offered_first() -> None:
    assert first_kind(artefact=True).needs_artefact
    assert not first_kind(artefact=False).needs_artefact
    assert first_kind(artefact=False).medium == "touch"


def test_kinds_are_offered_in_their_order() -> None:
    assert [*KINDS][:2] == ["pairwise_distance", "landmark"]
    assert "plane" in KINDS
    assert len(KINDS) == len([*KINDS])
    with pytest.raises(KeyError, match="plain"):
        KINDS["plain"]


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_what_a_device_may_send_are_columns_of_the_samples(kind: type[Term]) -> None:
    """And a kind that refuses rests says so of these columns, and takes good ones."""
    assert {*kind.sent} <= {number.name for number in kind.columns.numbers}
    some, none = np.ones(len(kind.sent)), np.zeros((0, len(kind.sent)))
    assert kind.refused_rest(some, 1e-3 * some, none) == ""
    assert kind.refused_rest(some, 1e-3 * some, np.array([some, some])) == ""
