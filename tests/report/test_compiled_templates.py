"""Templates are compiled once, kept where Python keeps its modules, and done without elsewhere."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from jinja2 import Environment

from suta_calib.report import page
from suta_calib.report.document import Document


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(page, "_COMPILED", tmp_path / "cache")
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    return tmp_path / "cache"


def told() -> str:
    from suta_calib.assessment import Assessment

    return page.page_with(Document("plan", "A <plan>", Assessment("good")), None)


def without_date(text: str) -> list[str]:
    return [line for line in text.splitlines() if "UTC" not in line]


def test_a_second_page_compiles_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = told()
    assert "A &lt;plan&gt;" in first
    assert list(folder.iterdir())

    def compiled(*_: object, **__: object) -> None:
        raise AssertionError("compiled again")

    monkeypatch.setattr(Environment, "compile", compiled)
    assert without_date(told()) == without_date(first)


@pytest.mark.parametrize("damage", ["other Python", "no folder", "not asked for"])
def test_pages_do_without(folder: Path, monkeypatch: pytest.MonkeyPatch, damage: str) -> None:
    if damage == "not asked for":
        monkeypatch.setattr(sys, "dont_write_bytecode", True)
    elif damage == "no folder":
        folder.touch()
    first = told()
    assert folder.is_dir() == (damage == "other Python")
    if damage == "other Python":
        for each in folder.iterdir():
            each.write_bytes(b"j2" + bytes(100))
    assert without_date(told()) == without_date(first)
