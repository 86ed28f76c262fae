"""``suta-calib study`` from end to end."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import dask
import pytest
from cli_job import Capture, answer, cli, refused
from lxml import etree
from study_scene import SUTA

JOB = SUTA / "calibration.yaml"
FEW = ("--trials", "3", "--jobs", "1")


def test_sizes_as_the_formats_have_them(tmp_path: Path) -> None:
    found = answer("study", JOB, *FEW, "--sizes", "1-2,6", "--out", tmp_path)
    assert [s["size"] for s in found["sizes"]] == [1, 2, 6]
    keys = {"size", "trials", "mean_mm", "std_mm", "min_mm", "max_mm", "improvement_pct"}
    for size in found["sizes"]:
        assert keys <= set(size)
        assert (size["trials"], size["failed"]) == (3, 0)
        assert 0.5 < size["min_mm"] <= size["mean_mm"] <= size["max_mm"] < 3
    first, *_, last = found["sizes"]
    gain = 100 * (1 - last["mean_mm"] / first["mean_mm"])
    assert last["improvement_pct"] == pytest.approx(gain)
    assert (found["unit"], found["sets"], found["kept_whole"]) == ("set", 15, [])
    assert found["metric"]["held_out"] == "validation data"
    assert found["uncalibrated_mm"] == pytest.approx(5.599, abs=1e-3)
    assert json.loads((tmp_path / "study.json").read_text()) == found


@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize(
    ("kind", "name"),
    [("size", "study"), ("bootstrap", "bootstrap"), ("monte-carlo", "monte_carlo")],
)
def test_what_is_written(tmp_path: Path, kind: str, name: str, capsys: Capture) -> None:
    ten = ("--trials", "12", "--jobs", "1", "--kind", kind, "--out", tmp_path)
    sizes = ("--sizes", "2,4") if kind == "size" else ()
    assert cli("study", JOB, *ten, *sizes) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert max(map(len, out.splitlines()[:-1])) <= 80
    files = {f"{name}{end}" for end in (".json", ".svg", ".trials.csv")} | {"report.html"}
    assert {path.name for path in tmp_path.iterdir()} == files
    etree.fromstring((tmp_path / f"{name}.svg").read_bytes())
    page = (tmp_path / "report.html").read_text()
    assert f'<section id="{name}">' in page
    # A second time it is continued, not repeated, and says the same.
    before = (tmp_path / f"{name}.json").read_bytes()
    assert cli("study", JOB, *ten, *sizes, "--resume") == 0
    assert (tmp_path / f"{name}.json").read_bytes() == before
    lines = (tmp_path / f"{name}.trials.csv").read_text().splitlines()
    assert len(lines) == 2 + 12 * (2 if kind == "size" else 1)


def test_parameters_of_a_bootstrap(tmp_path: Path) -> None:
    found = answer(
        "study", JOB, "--trials", "15", "--jobs", "1", "--kind", "bootstrap", "--out", tmp_path
    )
    told, silent = found["parameters"]["joint_4.z"], found["parameters"]["tip.y"]
    assert silent == {"unit": "m", "state": "unidentified", "told": 0}
    assert told["told"] == 15
    assert told["spread_mm"] == pytest.approx(1e3 * told["spread"])
    assert told["ratio"] == pytest.approx(told["spread"] / told["predicted_std"])
    assert told["interval"][0] < told["mean"] < told["interval"][1]
    assert found["validation"]["rms_mm"] == pytest.approx(0.925, abs=1e-3)


def test_a_job_without_placements_draws_samples(job: Path) -> None:
    """Two samples cannot be solved: they are counted, and told."""
    found = answer("study", job, *FEW, "--sizes", "2,20,40")
    assert (found["unit"], found["sets"], found["set_is"]) == ("sample", 40, "one sample")
    few, *others = found["sizes"]
    assert (few["failed"], few["mean_mm"], few["improvement_pct"]) == (3, None, None)
    assert all(s["failed"] == 0 for s in others)
    assert found["baseline_size"] == 20
    assert found["failures"][0]["count"] == 3
    assert "3 of 3 with 2" in " ".join(found["verdict"]["notes"])
    assert (job.parent / "results" / "study.json").is_file()


def test_no_result_at_all_exits_with_one(job: Path, capsys: Capture) -> None:
    assert cli("study", job, *FEW, "--sizes", "1-2") == 1
    out, err = capsys.readouterr()
    assert "Do not use" in out
    assert "(3 trials)" in out
    assert "Traceback" not in err


def test_sizes_beyond_the_sets_are_left_out_and_told(tmp_path: Path) -> None:
    found = answer("study", JOB, *FEW, "--sizes", "14-17", "--out", tmp_path)
    assert [s["size"] for s in found["sizes"]] == [14, 15]
    assert found["left_out_sizes"] == [16, 17]
    assert any("16 to 17" in note for note in found["verdict"]["notes"])
    assert "up to 15" in refused("study", JOB, "--sizes", "16", "--out", tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--sizes", "0-3"), "'0-3'.*numbers from 1"),
        (("--sizes", "5-2"), "'5-2'"),
        (("--sizes", "1-9:0"), "'1-9:0'"),
        (("--sizes", "all"), "'all'"),
        (("--sizes", ""), "numbers from 1"),
        (("--trials", "0"), "--trials"),
        (("--trials", "1000000000"), "--trials"),
        (("--jobs", "0"), "--jobs"),
        (("--tolerance-pct", "-1"), "--tolerance-pct"),
        (("--tolerance-pct", "nan"), "finite number"),
        (("--kind", "jackknife"), "--kind"),
        (("--kind", "bootstrap", "--sizes", "1-3"), "--sizes is for --kind size"),
        (("--unit", "point"), "no samples with labels point"),
        (("--dask", "nowhere"), "no scheduler"),
    ],
)
def test_bad_usage(tmp_path: Path, arguments: tuple[str, ...], says: str) -> None:
    pytest.importorskip("distributed")  # its settings are there once it is loaded
    with dask.config.set({"distributed.comm.timeouts.connect": "0.5s"}):
        line = refused("study", JOB, *arguments, "--out", tmp_path / "none")
    assert re.search(says, line), line
    assert not (tmp_path / "none").exists()


def test_another_study_is_not_resumed(job: Path, capsys: Capture) -> None:
    asked = (job, *FEW, "--sizes", "20", "--resume")
    assert cli("study", *asked) == 0
    results = job.parent / "results"
    before = {path: path.read_bytes() for path in results.iterdir()}
    capsys.readouterr()
    assert "(seed differs)" in refused("study", *asked, "--seed", "1")
    samples = job.parent / "calibration" / "a.csv"
    lines = samples.read_text().splitlines(keepends=True)
    samples.write_text("".join(lines[:-1]))
    assert "(job differs)" in refused("study", *asked)
    assert {path: path.read_bytes() for path in results.iterdir()} == before


def test_an_interrupt_says_how_to_go_on(
    job: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    from suta_calib.analysis.study import runner as study_runner

    run_trial = study_runner.run_trial

    def interrupted(data: Any, size: int, number: int) -> Any:
        if number == 2:
            raise KeyboardInterrupt
        return run_trial(data, size, number)

    monkeypatch.setattr(study_runner, "run_trial", interrupted)
    assert cli("study", job, *FEW, "--sizes", "20") == 130
    assert "continue with --resume" in capsys.readouterr().err
    results = job.parent / "results"
    assert [path.name for path in results.iterdir()] == ["study.trials.csv"]
