"""The study of corrupted jobs, in little: what goes wrong is refused or said, and named."""

from __future__ import annotations

import importlib.util
import json
import sys
from dataclasses import asdict, replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

CHECKED = {
    "instrument moved half-way": "refused",
    "instrument moved before validation": "refused",
    "validation repeats the calibration": "warned",
}


@pytest.fixture(scope="module")
def study(repository: Path) -> ModuleType:
    """``benchmarks/corruptions.py`` as a module."""
    sys.path.insert(0, str(repository / "benchmarks"))
    spec = importlib.util.spec_from_file_location(
        "corruptions", repository / "benchmarks" / "corruptions.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["corruptions"] = module
    spec.loader.exec_module(module)
    sys.path.pop(0)
    return module


@pytest.fixture(scope="module")
def sound(study: ModuleType) -> Any:
    """A job over an instrument, with bounds."""
    return next(study.sound_jobs(["tracked_point"], shipped=False, starts=1))


@pytest.fixture(scope="module")
def clean(study: ModuleType, sound: Any) -> Any:
    return study.outcome(sound, None)


def test_a_sound_job_is_usable_and_as_right_as_it_states(clean: Any) -> None:
    assert clean.level != "bad"
    assert clean.error < 3 * clean.stated


@pytest.mark.parametrize(
    ("kind", "parameters"), [("landmark", 0), ("landmark", 1), ("hand_eye", 0)]
)
def test_a_tip_that_these_data_cannot_tell_is_not_stated_as_sure(
    study: ModuleType, kind: str, parameters: int
) -> None:
    """Its drawing is off by 1.6 mm, and the tip by one: with bounds it is said, with priors ±."""
    job = [*study.sound_jobs([kind], shipped=False, starts=1)][parameters]
    found = study.outcome(job, None)
    assert found.error > 0.5e-3
    assert study.judge_sound(found).fate == "sound"


def test_sound_jobs_are_judged_too(study: ModuleType, clean: Any) -> None:
    assert study.judge_sound(clean).fate == "sound"
    far = replace(clean, level="good", error=1e-2, stated=1e-4)
    assert study.judge_sound(far).fate == "overstated"
    alarmed = replace(clean, level="care", said=(*clean.said, "joint_2 counts the other way."))
    assert study.judge_sound(alarmed).fate == "false alarm"
    assert study.judge_sound(replace(clean, level="refused")).fate == "false alarm"


@pytest.mark.parametrize("name", CHECKED)
def test_what_went_wrong_is_named(study: ModuleType, sound: Any, clean: Any, name: str) -> None:
    corruption = next(c for c in study.CORRUPTIONS if c.name == name)
    judged = study.judge(study.outcome(sound, corruption), clean, corruption)
    assert judged.fate == CHECKED[name]
    assert judged.named


def made(folder: Path, name: str) -> Path:
    """A new folder in a folder."""
    (folder / name).mkdir()
    return folder / name


def files(job: Path) -> dict[str, bytes]:
    """What lies beside a job, by its path there."""
    found = (path for path in job.parent.rglob("*") if path.is_file())
    return {str(path.relative_to(job.parent)): path.read_bytes() for path in found}


def test_every_corruption_changes_the_files_it_can_happen_to(
    study: ModuleType, tmp_path: Path
) -> None:
    happened = set()
    for kind in ("landmark", "hand_eye", "fixed_point"):
        job = next(study.sound_jobs([kind], shipped=False))
        untouched = files(study.corrupted(job, None, made(tmp_path, job.name)))
        for corruption in filter(job.suffers, study.CORRUPTIONS):
            folder = made(tmp_path, f"{job.name} {corruption.name}")
            assert files(study.corrupted(job, corruption, folder)) != untouched
            happened.add(corruption.name)
    assert happened == {c.name for c in study.CORRUPTIONS}


def test_silence_is_judged_by_the_tip_and_by_new_words(study: ModuleType, clean: Any) -> None:
    corruption = study.CORRUPTIONS[0]
    wrong = replace(clean, level="good", error=1e-2, stated=1e-4)
    assert study.judge(wrong, clean, corruption).fate == "silently wrong"
    assert study.judge(replace(wrong, stated=1e-2), clean, corruption).fate == "unharmed"
    said = replace(wrong, level="care", said=(*clean.said, "joint_2 counts the other way."))
    judged = study.judge(said, clean, corruption)
    assert (judged.fate, judged.named) == ("warned", True)
    refused = replace(said, level="bad", error=np.nan)
    assert study.judge(refused, clean, corruption).fate == "refused"


def test_a_study_that_was_stopped_goes_on(study: ModuleType, clean: Any, tmp_path: Path) -> None:
    """What its file tells is not found again: here a job that could not be."""
    other, corruption = replace(clean, job="no job"), study.CORRUPTIONS[0]
    told = [other, replace(other, corruption=corruption.name, level="bad", error=np.nan)]
    file = tmp_path / "outcomes.json"
    lines = [json.dumps({"outcome": asdict(each), "fate": ""}) + "\n" for each in told]
    file.write_text("".join(lines))
    everything = SimpleNamespace(path="calibration/P.csv", samples=SimpleNamespace(labels={}))
    nobody = study.Sound("no job", "", SimpleNamespace(files=[everything]))
    found = study.study([nobody], [corruption], shown=False, known=study.read_outcomes(file))
    assert [each.fate for each in found] == ["sound", "refused"]
