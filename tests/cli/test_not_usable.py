"""What builds on a calibration refuses one that must not be used, or carries that on."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_job import Capture, answer, cli, made_worse, refused, write_simulated_job

WHY = "worse than the nominal arm on the validation data"
BOX = ("--region", "150,600,-300,300,0,400", "--grid", "5")


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    """A job whose held-out data are of an arm that is off the other way."""
    return made_worse(write_simulated_job(tmp_path_factory.mktemp("worse") / "job", suta_urdf))


@pytest.mark.parametrize(
    "asked",
    [("study", "--trials", "1", "--sizes", "30", "--jobs", "1"), ("budget",), ("tip-map", *BOX)],
)
def test_nothing_is_built_on_it_but_by_will(
    job: Path, tmp_path: Path, asked: tuple[str, ...]
) -> None:
    command, *options = asked
    said = refused(command, job, *options, "--out", tmp_path / "out")
    assert f"{job}: found a result that must not be used" in said
    assert WHY in said
    assert "--anyway" in said
    assert not (tmp_path / "out").exists()
    assert cli(command, job, *options, "--out", tmp_path / "out", "--anyway", "--json") == 0


@pytest.mark.parametrize("asked", [("plan", "-n", "1", "--tilt", "0"), ("extend", "--quick")])
def test_what_may_mend_it_says_so_and_exits_with_one(
    job: Path, tmp_path: Path, asked: tuple[str, ...]
) -> None:
    command, *options = asked
    verdict = answer(command, job, *options, "--out", tmp_path, code=1)["verdict"]
    assert verdict["level"] == "bad"
    assert WHY in verdict["notes"][0]


def test_the_map_of_a_result_needs_the_arm_that_was_calibrated(
    tmp_path: Path, suta_urdf: Path, capsys: Capture
) -> None:
    job = write_simulated_job(tmp_path / "job", suta_urdf)
    assert cli("calibrate", job, "--out", tmp_path, "--json") == 0
    capsys.readouterr()
    arm = job.parent / "arm.urdf"
    calibrated = ("tip-map", tmp_path / "result.json", "--tip", "tip", *BOX, "--urdf")
    assert cli(*calibrated, arm) == 0
    # Neither the arm that came out, nor one that happens to have the same joints.
    for other, told in ((tmp_path / "calibrated.urdf", "joint_"), (arm, "joint_2")):
        if other == arm:
            arm.write_text(arm.read_text().replace('xyz="0 0 0.047"', 'xyz="0 0 0.057"'))
        said = refused(*calibrated, other)
        assert f"{other}: found an arm that was not the one calibrated" in said
        assert told in said
