"""The notebooks run from beginning to end, and what is stored in them can be shown to anybody."""

from __future__ import annotations

import json
import re
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

import nbformat
import pytest
from forked_notebook import Computed, run_notebook
from nbclient import NotebookClient
from simulated import ROBOT_FILES, ROBOTS

NOTEBOOKS = sorted((Path(__file__).resolve().parent.parent / "notebooks").glob("*.ipynb"))
STEREOTACTIC = "04_stereotactic_navigation"
(REPORT_NOTEBOOK,) = (path for path in NOTEBOOKS if path.stem == STEREOTACTIC)
# The others differ in what they compute, not in how Jupyter runs it.
IN_A_KERNEL = "01_quickstart"
# What each notebook needs beside itself, at the same place relative to it.
NEEDED = (
    *("data/suta", "data/accuracy", "data/artefact", "data/thesis", "data/workcell"),
    *("urdf", "examples/two_arms", "examples/whole_robot"),
)
# Whose arm it needs from example-robot-data.
OTHER_ARMS = {"00_look_around": "ur5", "02_other_arms": "panda", "07_where_to_measure_next": "ur5"}
# Which package of an extra it needs.
NEEDS = {"00_look_around": "viser", "08_from_pictures": "cv2"}
MOST_BYTES = 500_000
# Figures the prose repeats: what is computed must still say so.
CLAIMED = {
    "00_look_around": ("held out: 4.53 → 0.096 mm RMS", "errors × 1000"),
    "01_quickstart": ("10 of 13 unknowns", "Solve_Succeeded", "-223.0 mm", " 0.93\n", " 0.24\n"),
    "02_other_arms": (
        "25 of 55 unknowns",
        "RMS 6.17 mm → 0.09",
        "6 joints climbed, 6 descended",
        "held out: RMS 6.88 mm → 0.172 mm",
        "redundant: left_6.offset, right_6.offset",
    ),
    "03_pivot_and_hand_eye": (
        "REFUSED, found poses that do not determine the tip in the tool: it may slide along (0.71,",
        "RMS of z within 20 % of 1: True",
        "rows left out are the 18 spoilt ones: True",
        "rows left out are the 12 spoilt ones: True",
        "the same data taken for eye-in-hand: REFUSED",
        "calibrate_hand_eye  position of X in m or in mm: differs by 0.0000 mm",
        "unidentified: joint_6.offset, tip.y, tip.z",
        "camera and touches: converged: 24 of 24 unknowns",
        "pivot, 45 % slipped: bad",
    ),
    STEREOTACTIC: (
        "any five motions, skew(vA - vB): singular values [3.23741388 3.23741388 3.23741388 3.2",
        "set bent: degree 5, left-out frames 0.0057 mm",
        "goes on by degree 3, rms error 0.138 mm (0.091 expected)",
        "the same staying as at the border: 0.880 mm",
    ),
    "05_from_encoders_to_poses": ("that are not what was sent: 0", "8 of 10 unknowns", "12.8 mm"),
    "06_how_far_to_trust_it": (
        "13 unknowns          1.49      0.93",
        "whole geometry       1.26      0.24",
        "predicted 0.05 mm, made 0.05 mm; RMS of made / predicted 1.03",
        "RMS of made / predicted 3.39",
        "13 unknowns: 2 sets are enough",
        "0.93 mm with the right certificate, 1.00 mm with the wrong one",
        "certificate right: no landmark is an outlier",
        "Outliers: landmark M4",
        "RP 1.74 mm (95 %: 1.11 to 2.96)",
        "proved better: True",
        "joint_4 gives by 0.102",
        "up to 1.37 mm; all fifteen 0.93 mm",
        "E_Uni          -0.127 mm, limit 0.210, U 0.029: pass",
        "Passed: 5 of 5 limits are met",
        "RMS 0.422 mm with the job's model, 0.243 mm",
        "undecided to 0.154",
        "amaged or touched wrongly: S2",
        "13 unknowns            0.014       0.238       0.014       0.320       0.835",
        "whole geometry         0.014       0.238       0.014       0.038       0.000",
        "added beside geometry: nothing",
        "joint_6 first harmonic                     left-out variance  -38 %",
        "joint_3.ecc_c1   0.2040 ± 0.0057 deg",
        "made 0.11 mm RMS, predicted 0.13 mm",
        "97 % of the mean square",
    ),
    "07_where_to_measure_next": (
        "10 of 13 unknowns",
        "a distance scatters by 0.22 mm\n",
        "tilted by 20°              1 mm more of tool is seen as 0.0000 mm   tip.y open",
        "one point from many sides  1 mm more of tool is seen as 0.66",
        "… if fixed parameters are exact    0.137",
        "F253    predicted 0.073 mm",
        "N132    predicted 0.043 mm",
        "made within 35 % of predicted: True",
        "the thesis' five alone, 6 arms: over 0.4 mm: True",
        "made over predicted: at least 5: True",
        "every set with a point is better than every set without: True",
        "at least 1.5 times better: True",
        "13 unknowns: a distance scatters by 0.71 mm; 3 held\n  planned 0.477 mm; made 2.5",
        "with the planned four\n  made within a factor of 1.5 of planned: False",
        "48 unknowns: a distance scatters by 0.22 mm; 28 held",
        "with the planned four\n  made within a factor of 1.5 of planned: True",
        "planned < by lot < half of all by hand: True",
    ),
    "08_from_pictures": (
        "648 corners found in 12 of 12 pictures",
        "below 27: True",
        "within three standard deviations: True",
        "27 of 27 unknowns",
    ),
    "09_the_thesis": (
        "table 3.2: 10 of 13 can be told; not joint_1.offset, joint_2.z, tip.y",
        "table 4.2: 8 of 12 can be told; not joint_1.offset, joint_2.z, joint_6.offset, tip.z",
        "| optimised | thesis (525) | 1.01 | 0.80 | 0.61 | 3.01 |",
        "|  | ours (525, averaged) | 0.96 | 0.73 | 0.62 | 4.25 |",
        "ours 0.292 ± 0.010 mm",
        "| 1 | 1.43 ± 0.11 | 1.12 ± ",
        "seats, encoders and artefact 0.24, model 0.95",
        "| RMS against the drawing | 0.19 mm | 0.19 mm | put in |",
        "would move the tip by 1.8 mm RMS",
        "outliers: landmark S2",
    ),
    "11_line_scanner": (
        "16 of 16 scans agree to 0.33",
        "Scan s5 fits the others with x reversed",
        "less than its ±: True",
        "within three standard deviations: True",
    ),
    "10_two_arms_on_a_torso": (
        "joints that both share:  waist_yaw, waist_roll, waist_pitch",
        "held out: 12.19 → 1.20 mm RMS",
        "look like a link or bearing that bends under gravity",
        "left: held out 0.51 mm RMS",
        "head seen from left: held out 0.09 mm RMS",
        "208 parameters: errors over ±, standard deviation 0.98",
    ),
}
# What the report's sections of notebook 04 say where the course's files are beside the repository:
# the stored outputs were made so.
OF_COURSE = (
    "  ours      0.0049   0.4709   0.3841   0.0115   1.5668   1.7237   1.7661",
    "  ours      0.0024   0.0041   0.0028   0.0027   0.0100   0.0190   0.0122",
    "  truth     0.0024   0.0041   3.3957   0.0027   5.3315   7.3312   5.1528",
    "h  report  181.05   182.96   199.87   ours   181.05 ± 4.44    182.96 ± 16.98    199.87 ± 4.51",
    "  ours      0.0070   0.0060   0.0013   0.0055   0.0041   0.0010   0.0055",
    "k  report  391.34   397.05   196.42   ours   391.34 ± 0.01    397.05 ± 0.01    196.42 ± 0.00",
    "AX - XB  574.5 mm,  72.84°",
    "turned against the report's by 101.4°",
    "against all ten pairs: 0.25°, 4.4 mm",
)
COURSE_SECTIONS = ("## The report's tables", "## The report's hand-eye section")
# Two components at least, so that "mm/s" and "</td>" are none.
ABSOLUTE_PATH = re.compile(r"(?<![\w.:/<])(?:/[\w.~-]+){2,}|\b[A-Za-z]:\\\w|file://")

every_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def outputs(notebook: nbformat.NotebookNode) -> Iterator[nbformat.NotebookNode]:
    for cell in notebook.cells:
        yield from cell.get("outputs", [])


def texts(notebook: nbformat.NotebookNode) -> Iterator[str]:
    """Everything stored in outputs but the pictures."""
    for output in outputs(notebook):
        yield output.get("text", "")
        for kind, content in output.get("data", {}).items():
            if not kind.startswith("image/"):
                yield content if isinstance(content, str) else json.dumps(content)


def pictures(notebook: nbformat.NotebookNode) -> int:
    return sum("image/png" in output.get("data", {}) for output in outputs(notebook))


def test_notebooks_are_found():
    assert [path.stem for path in NOTEBOOKS] == [
        "00_look_around",
        "01_quickstart",
        "02_other_arms",
        "03_pivot_and_hand_eye",
        "04_stereotactic_navigation",
        "05_from_encoders_to_poses",
        "06_how_far_to_trust_it",
        "07_where_to_measure_next",
        "08_from_pictures",
        "09_the_thesis",
        "10_two_arms_on_a_torso",
        "11_line_scanner",
    ]


@pytest.mark.notebook
@every_notebook
def test_runs_without_error(path: Path, repository: Path, tmp_path: Path):
    robot = OTHER_ARMS.get(path.stem)
    if robot is not None and not (ROBOTS / ROBOT_FILES[robot][0]).is_file():
        pytest.skip("example-robot-data is not installed")
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem])
    root = tmp_path / "repository"
    for folder in NEEDED:
        shutil.copytree(repository / folder, root / folder)
    beside = repository.parent / "shared"
    of_course = (beside / "data" / "cis_pa1").is_dir() and path.stem == STEREOTACTIC
    if of_course:
        (tmp_path / "shared").symlink_to(beside)
    copy = root / "notebooks" / path.name
    copy.parent.mkdir()
    shutil.copy(path, copy)
    notebook = nbformat.read(copy, as_version=4)
    stored = pictures(notebook)
    if path.stem == IN_A_KERNEL:
        resources = {"metadata": {"path": str(copy.parent)}}
        NotebookClient(notebook, kernel_name="python3", timeout=900, resources=resources).execute()
        told = [o.text for o in outputs(notebook) if o.get("name") == "stderr"]
        found = Computed([*texts(notebook)], pictures(notebook), told)
    else:
        found = run_notebook(notebook, copy.parent)
    assert not found.error, found.error
    assert not found.warned
    assert found.pictures == stored
    computed = "".join(found.texts)
    claimed = (*CLAIMED[path.stem], *(OF_COURSE if of_course else ()))
    assert [figure for figure in claimed if figure not in computed] == []


def test_the_reports_sections_were_stored_with_the_courses_files():
    stored = "".join(texts(nbformat.read(REPORT_NOTEBOOK, as_version=4)))
    assert [figure for figure in OF_COURSE if figure not in stored] == []


def test_the_reports_sections_run_without_the_courses_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    cells = nbformat.read(REPORT_NOTEBOOK, as_version=4).cells
    begin = {cell.source.partition("\n")[0]: k for k, cell in enumerate(cells)}
    chosen = [cells[2], *(cells[begin[title] + 1] for title in COURSE_SECTIONS)]
    (tmp_path / "repository" / "notebooks").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "repository" / "notebooks")
    names: dict[str, object] = {}
    with warnings.catch_warnings():
        for cell in chosen:
            exec(re.sub("^%.*$", "", cell.source, flags=re.M), names)
    printed = capsys.readouterr().out
    assert "Without ours for a, b, c, d, e, f, g, h, i, j, k" in printed
    assert "Without ours: ../../shared/data/hand_eye_rviz does not have the pairs." in printed
    assert "report    0.0049   0.4709" in printed


@every_notebook
def test_stored_outputs_can_be_shown(path: Path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    kinds = [output.output_type for output in outputs(notebook)]
    assert kinds, "stored without outputs"
    assert "error" not in kinds
    assert pictures(notebook) >= 3
    assert [found for text in texts(notebook) for found in ABSOLUTE_PATH.findall(text)] == []
    assert path.stat().st_size < MOST_BYTES


@every_notebook
def test_the_set_up_is_short_and_what_is_shown_was_meant_to_be(path: Path):
    """What is needed later is imported where it is first used."""
    notebook = nbformat.read(path, as_version=4)
    first = next(cell.source for cell in notebook.cells if cell.cell_type == "code")
    assert len([line for line in first.splitlines() if line]) <= 6
    stored = (output.get("data", {}).get("text/plain", "") for output in outputs(notebook))
    assert not [text for text in stored if text.startswith(("array(", "(array(", "[array("))]


@every_notebook
def test_cells_were_stored_in_the_order_they_ran(path: Path):
    cells = [c for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code"]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))


@every_notebook
def test_says_first_what_is_learnt_and_that_data_are_simulated(path: Path):
    first = nbformat.read(path, as_version=4).cells[0]
    assert first.cell_type == "markdown"
    assert "You will learn" in first.source
    assert re.search(r"\*\*The measurements .*simulated", first.source)


@pytest.mark.parametrize(
    "text", ["at /home/anna/arm.urdf", "'/tmp/x7/a.csv'", r"C:\Users", "file:///x", "(/opt/a/b)"]
)
def test_absolute_paths_are_noticed(text: str):
    assert ABSOLUTE_PATH.search(text)


@pytest.mark.parametrize(
    "text",
    ["../data/suta", "mm/s/A", "</td></tr>", "https://a.org/b/c", "data/suta/truth.yaml", "/"],
)
def test_other_slashes_are_not(text: str):
    assert not ABSOLUTE_PATH.search(text)
