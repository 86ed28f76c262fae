"""Kinds of observation and the columns of CSV files: what kinds and readers say of themselves."""

from __future__ import annotations

from collections.abc import Iterator

from markdown_pieces import anchor, first_paragraph, sentence, table
from repository_pages import ROOT
from yaml_pages import key_tables

from suta_calib.certification import read_raw_points
from suta_calib.measurements import NumberColumn, pose_files, read_corners
from suta_calib.measurements.csv_table import position_columns, rotation_columns
from suta_calib.measurements.fields import Fields
from suta_calib.registry import shipped
from suta_calib.terms import KINDS, Term


def observations_page() -> Iterator[str]:
    """What each kind of observation says of itself, and its samples' columns."""
    yield "# Kinds of observation\n\n"
    yield (
        "For each kind: what was measured, the columns of its samples (in addition to one per "
        "joint, in rad, or m for prismatic joints), its keys in a row of a job, the parameters "
        "that it cannot determine alone, and those that it determines where other kinds cannot."
        "\n\n"
    )
    for name, kind in shipped(KINDS).items():
        yield f"({anchor(name)})=\n## {name}\n\n{sentence(kind.about)}\n\n"
        yield f"{first_paragraph(kind)} More: {{py:class}}`~suta_calib.terms.{kind.__name__}`.\n\n"
        rows = list(column_rows(kind))
        yield table(("column", ""), rows)
        if kind.needs_artefact:
            yield "Needs an [`artefact.yaml`](files.md#artefact-yaml).\n\n"
        if kind.keys:
            yield "Its keys:\n\n"
            yield from key_tables(Fields(*kind.keys), set())
        if kind.leaves_open:
            yield "What it cannot determine:\n\n"
            for gap, (why, remedy) in kind.leaves_open.items():
                yield f"* the {gap}: {why}. To determine it: {remedy}.\n"
            yield "\n"
        if kind.tells:
            told = "; ".join(f"the {gap} ({advice})" for gap, advice in kind.tells.items())
            yield f"Determines what other kinds may not: {told}.\n\n"


def column_rows(kind: type[Term]) -> Iterator[tuple[str, str]]:
    """The columns of a kind's samples beside the joints', and what they hold."""
    columns = kind.columns
    optional = {*columns.common_labels, *columns.optional_labels}
    optional |= {number.name for number in columns.numbers if not number.required}
    position, rotation = ", ".join("xyz"), ", ".join(rotation_columns())
    if columns.orientation == "optional":
        optional.add(rotation)
    shown = {name: f"`{name}`" for name in columns.labels}
    if columns.position:
        shown[position] = f"`{position}` in m, or `{', '.join(position_columns()[3:])}`"
    if columns.orientation != "none":
        shown[rotation] = f"`{rotation}`"
    for number in columns.numbers:
        shown[number.name] = number_columns(number)
    shown |= {n: f"`{n}`" for n in (*columns.common_labels, *columns.optional_labels)}
    for name, text in shown.items():
        about = columns.about.get(name, "")
        yield text, f"{about} May be left out." if name in optional else about


def number_columns(number: NumberColumn) -> str:
    """The names that a column of numbers may have."""
    names = [f"`{name}`" for name in number.names]
    return f" in {number.unit}, or ".join(names) if number.unit != "1" else names[0]


# CSV files that are no samples: by name, what they are, what reads them, a shipped one.
CSV_FILES = {
    "POSES.csv": (
        "Poses of a tracked tool, `T_tracker_tool`; with the column `point` for several posts.",
        pose_files.read_tool_poses,
        "examples/pivot_tool/poses.csv",
    ),
    "PAIRS.csv": (
        "`T_base_hand` and `T_eye_target`; both poses of a row were taken at the same time.",
        pose_files.read_pose_pairs,
        "data/poses/hand_eye.csv",
    ),
    "HANDS.csv": (
        "`T_base_hand` with the name of the picture taken at this pose.",
        pose_files.read_hand_poses,
        "data/workcell/poses.csv",
    ),
    "POINTS.csv": (
        "Points in one frame.",
        pose_files.read_points,
        "data/poses/register_a.csv",
    ),
    "corners.csv": (
        "Positions of the corners of a board in pictures.",
        read_corners,
        "data/workcell/corners.csv",
    ),
    "TOUCHES.csv": (
        "Raw points of a laser tracker on an artefact, for `suta-calib certify`.",
        read_raw_points,
        "data/artefact/points.csv",
    ),
}


def csv_page() -> Iterator[str]:
    """Every CSV file: samples by kind, and the others by what their readers say."""
    yield "# CSV files\n\n"
    yield (
        "A header row, commas, one row per measurement. The columns can be in any order, and "
        "unknown columns are ignored. Lengths are in m, or in mm if the name of the column ends "
        "in `_mm` (`x_mm`); quaternions are `qx, qy, qz, qw`.\n\n"
        "## Samples of an arm\n\n"
        "One column per joint of the chain, named as in the URDF, in rad (m for prismatic "
        "joints), as the encoder reports it; a joint that mimics another has no column. Optional "
        "columns: `JOINT.direction`, the side from which a joint came (1 or -1); "
        "`temperature` of the arm (°C); `payload_kg`, the mass that the tip carries, with "
        "`payload_x, payload_y, payload_z` (m, or in mm with `_mm`), the place of its centre in "
        "the frame of the tip (its origin without them); `stroke`, equal for rows of one file that "
        "the arm passed through in one stroke of a motion without stops: they share errors, and "
        "the ± count them once; the columns that `tilt_sensors` of the arm names. Each kind needs "
        "these columns in addition:\n\n"
    )
    rows = (
        (f"[`{name}`](observations.md#{anchor(name)})", "; ".join(a for a, _ in column_rows(kind)))
        for name, kind in shipped(KINDS).items()
    )
    yield table(("kind", "columns"), rows)
    for name, (about, reader, example) in CSV_FILES.items():
        first = (ROOT / example).read_text(encoding="utf-8").splitlines()[:3]
        yield f"## {name}\n\n{about} {first_paragraph(reader)}\n\n"
        yield "```text\n" + "\n".join(first) + "\n```\n\n"
