"""What the README and the site's pages show runs as it stands there, where it needs no device."""

from __future__ import annotations

import io
import re
import shlex
import shutil
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from shown_blocks import BLOCKS, PACKAGES, SHELL, Block, words

from suta_calib import ArmModel
from suta_calib.cli._app import app, run

# What is not run here, by the beginning of the line, and why; the options are looked up even so.
DEVICE = "needs a device or an emulator for as long as it says; tests/cli and notebook 05 run it"
NOT_RUN = {
    "suta-calib demo": "4 s; tests/cli/test_demo.py",
    "suta-calib emulate": DEVICE,
    "suta-calib monitor": DEVICE,
    "suta-calib measure": DEVICE,
    "suta-calib guide": DEVICE,
    "suta-calib track": DEVICE,
    "suta-calib path-accuracy": "compares what was tracked; tests/tracking/test_path_accuracy.py",
    "suta-calib zero-offsets": "needs the emulator's truth; tests/cli/test_zero_offsets.py",
    "suta-calib calibrate calibration.yaml": "what measure wrote; tests/acquisition",
    "suta-calib detect": "needs OpenCV; tests/cli/test_detect.py",
    "suta-calib hand-eye data/workcell": "what detect wrote; tests of hand-eye --corners",
    "suta-calib hand-eye poses.csv": "files by name; tests/cli/test_hand_eye_pictures_by_name.py",
    "suta-calib pivot poses.csv": "a reader's own file; the page's first command runs",
    "suta-calib register ct.csv": "a reader's own files; tests/pose_calibration/test_proof.py",
    "suta-calib certificate pointer": "of the line before; tests/certificate",
    "suta-calib export results": "of the lines before; the tutorials' run",
    "suta-calib init so101": "tests/test_hobby_arm.py runs the page",
    "suta-calib motors": "the same",
    "suta-calib calibrate my_arm": "the same",
    "suta-calib export my_arm": "the same",
    "suta-calib check my_arm": "the same",
    "suta-calib view": "needs viser; tests/view",
    "suta-calib init ur.urdf.xacro": "tests/model/test_xacro.py",
    "suta-calib init my_arm.urdf --tip tool0 --kind height": "tests/test_own_kind.py",
    "suta-calib simulate gauge.yaml": "the same",
    "suta-calib calibrate heights": "the same",
    "suta-calib check": "needs a result and new rows; tests/cli/test_check.py",
    "suta-calib outliers": "7 s; tests/cli/test_outliers.py",
    "suta-calib study": "20 s; tests/cli/test_study.py",
    "suta-calib extend": "13 s; tests/cli/test_nongeometric.py",
    "suta-calib plan": "8 s; tests/cli/test_plan.py",
    "suta-calib tip-map": "8 s; tests/tracking/test_tip_uncertainty.py",
    "suta-calib residual-map": "13 s; tests/analysis/test_residual_map.py",
    "suta-calib calibrate examples": "tests/test_examples.py, tests/test_simulated_examples.py",
    "suta-calib calibrate robots": "many jobs, made there; tests/fleet",
    "suta-calib calibrate 'robots": "the same",
    "suta-calib observe examples": "what calibrate asks first; the same",
}
# Examples that the pages' commands and lines of Python read.
KEPT = ("pivot_tool", "ros_hand_eye", "stylus_polaris", "ur5_laser_tracker", "whole_robot")
# Entries of a sequence that are looked at.
MOST = 30
PUBLIC = {
    getattr(import_module(package), name)
    for package in ("suta_calib", *PACKAGES)
    for name in getattr(import_module(package), "__all__", ())
    if isinstance(getattr(import_module(package), name), type)
}
COMMAND_LINES = list(dict.fromkeys(line for block in SHELL for line in block.commands))


@pytest.fixture
def folder(repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of what the commands read; the working directory."""
    examples = (f"examples/{name}" for name in KEPT)
    for name in ("data", "urdf", *examples):
        ignored = shutil.ignore_patterns("results")
        shutil.copytree(repository / name, tmp_path / name, ignore=ignored)
    arm = (tmp_path / "urdf/suta.urdf").read_text(encoding="utf-8").replace('"tip"', '"tool0"')
    for name in ("arm.urdf", "my_arm.urdf"):
        (tmp_path / name).write_text(arm, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def own_arrays() -> dict[str, Any]:
    """Readings, and where a tracker saw the tip, of an arm with errors: "your own arrays"."""
    arm = ArmModel.from_urdf("arm.urdf", tip="tool0")
    random = np.random.default_rng(0)
    q = random.uniform(-1.5, 1.5, (60, len(arm.joints)))
    _, seen = arm.forward(q, {"joint_2.offset": 0.02, "joint_4.z": 0.574})
    return {"q": q, "seen_by_tracker": seen + 5e-5 * random.standard_normal(seen.shape)}


def reached(values: list[Any]) -> Iterator[Any]:
    """Objects of this package's public classes among values, and all that they hold."""
    known, waiting = set[int](), values
    while waiting:
        value = waiting.pop()
        if id(value) in known:
            continue
        known.add(id(value))
        if isinstance(value, Mapping):
            waiting += [*value.values()][:MOST]
        elif isinstance(value, tuple | list):
            waiting += value[:MOST]
        elif type(value).__module__.startswith("suta_calib.") and not isinstance(value, type):
            waiting += getattr(value, "__dict__", {}).values()
            if not type(value).__name__.startswith("_") and type(value) in PUBLIC:
                yield value


def lines_of(value: object) -> int:
    """How many lines of a console, 100 characters wide, an object takes to show itself."""
    return sum(1 + len(line) // 100 for line in repr(value).splitlines())


# What these show is run by tests/solver/test_own_solver.py and tests/test_own_kind.py.
OTHERS = {"docs/guides/extend.md", "docs/tutorials/own_kind.md"}
PYTHON = sorted({block.page for block in BLOCKS if block.language == "python"} - OTHERS)


@pytest.mark.parametrize("page", PYTHON)
def test_python_runs_and_prints_what_its_comments_say(page: str, folder: Path) -> None:
    names: dict[str, Any] = own_arrays()
    printed = io.StringIO()
    python = [block.text for block in BLOCKS if block.page == page and block.language == "python"]
    code = [compile(text, page, "exec") for text in python]
    for each in code:
        with redirect_stdout(printed):
            exec(each, names)
    said = re.findall(r"^ *print\(.*\)  # (.*)$", "\n".join(python), re.M)
    assert said
    for line, claim in zip(printed.getvalue().splitlines(), said, strict=True):
        assert line.startswith(claim.removesuffix("…").strip())
    assert (folder / "calibrated.urdf").is_file()
    assert [type(each).__name__ for each in reached([*names.values()]) if lines_of(each) > 10] == []
    assert names.get("solution", names["result"].solution).converged


def prepared(line: str) -> None:
    """Do what a line asks for that is not `suta-calib`'s."""
    if line.startswith("mkdir "):
        Path(line.split()[1]).mkdir()
    elif line.startswith("python -c "):
        exec(shlex.split(line)[2], {})
    elif line.startswith("# fill in "):
        for name in ("calibration", "validation", "fixed_point"):
            shutil.rmtree(Path("my_job", name))
            shutil.copytree(Path("data/suta", name), Path("my_job", name))
        shutil.copy("data/suta/artefact.yaml", "my_job/artefact.yaml")


def runs(line: str) -> bool:
    """Whether a line is tried here."""
    return line.startswith("suta-calib ") and not line.startswith(tuple(NOT_RUN))


TRIED = [block for block in SHELL if any(map(runs, block.commands))]


@pytest.mark.parametrize("block", TRIED, ids=lambda block: f"{block.page} {block.commands[0]}")
def test_commands_run(block: Block, folder: Path) -> None:
    for name, text in re.findall(r"^cat > (\S+) <<'END'\n(.*?)^END$", block.text, re.M | re.S):
        Path(name).write_text(text, encoding="utf-8")
    for line in block.lines:
        if not line.startswith("suta-calib "):
            prepared(line)
        elif runs(line):
            assert run(words(line)) == 0, line


@pytest.mark.parametrize("line", COMMAND_LINES)
def test_options_exist(line: str) -> None:
    name, *arguments = words(line)
    command = app.get_command(click.Context(app), name)
    assert command is not None
    given = {word for word in arguments if re.match(r"--?[a-z]", word)}
    known = {option for parameter in command.params for option in parameter.opts}
    assert given <= known


@pytest.mark.parametrize("line", COMMAND_LINES)
def test_files_it_names_are_there(line: str, repository: Path) -> None:
    kept = re.compile(r"(data|examples|urdf)/\S+")
    for word in words(line):
        if kept.fullmatch(word) and "/simulated" not in word:
            assert (repository / word).exists(), word


def test_every_line_left_out_is_there() -> None:
    assert [start for start in NOT_RUN if not any(c.startswith(start) for c in COMMAND_LINES)] == []
