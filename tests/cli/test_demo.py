"""`suta-calib demo`: the examples that come with the package."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from cli_job import Capture, cli, refused

from suta_calib import demo


def test_the_demo_in_an_empty_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """The measured arm and the camera; `make dist` runs all of it from the wheel."""
    tried = demo.EXAMPLES[::2]
    monkeypatch.setattr("suta_calib.cli.demo.EXAMPLES", tried)
    monkeypatch.chdir(tmp_path)
    assert cli("demo") == 0
    stdout = capsys.readouterr().out
    assert "[1 of 2] a measured UR5" in stdout
    assert "0.92 → 0.11 mm RMS on 320 validation positions" in stdout
    assert "[2 of 2]" in stdout
    reports = re.findall(r"^  (\S+report\.html)$", stdout, re.MULTILINE)
    assert len(reports) == len(tried)
    assert all(Path(report).is_file() for report in reports)
    # What it says it did can be done once more, there.
    monkeypatch.chdir(tmp_path / "suta-calib-demo")
    for example in demo.EXAMPLES:
        assert Path(example.file).is_file()
    assert Path(demo.PICTURES[1]).is_dir()


def test_what_was_changed_is_not_replaced(tmp_path: Path) -> None:
    demo.write_examples(tmp_path)
    job = tmp_path / demo.EXAMPLES[0].file
    demo.write_examples(tmp_path)
    job.write_text("mine", encoding="utf-8")
    assert f"{job}: found a file that was changed" in refused("demo", "--out", tmp_path)
    assert job.read_text(encoding="utf-8") == "mine"


def test_an_installed_package_has_the_files_in_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    demo.write_examples(tmp_path / "suta_calib" / "demo" / demo.FILES)
    monkeypatch.setattr(demo, "_HERE", tmp_path / "suta_calib" / "demo")
    demo.write_examples(tmp_path / "out")
    written = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    # A few hundred kB: whoever installs the package loads them.
    assert 200e3 < sum(path.stat().st_size for path in written) < 800e3


def test_the_wheel_has_what_the_demo_needs(repository: Path) -> None:
    build = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    wheel = build["hatch"]["build"]["targets"]["wheel"]
    patterns = [f"/{pattern}" for example in demo.EXAMPLES for pattern in example.files]
    assert wheel["include"] == ["/suta_calib", *patterns]
    places = {f"suta_calib/demo/{demo.FILES}/{folder}" for folder in wheel["sources"]}
    assert places == {*wheel["sources"].values()}
    assert {pattern.split("/")[1] for pattern in patterns} == {*wheel["sources"]}
