"""Each fact about the project stands in one place, or the places agree."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.version import Version

import suta_calib


@pytest.fixture(scope="module")
def project(repository: Path) -> dict[str, Any]:
    """The table ``[project]`` of pyproject.toml."""
    text = (repository / "pyproject.toml").read_text(encoding="utf-8")
    table: dict[str, Any] = tomllib.loads(text)["project"]
    return table


def pinned(file: Path) -> dict[str, Version]:
    """Package → the version a constraints file asks for, on Python 3.11."""
    lines = re.findall(r"^[\w.-]+==[^\\\n]+", file.read_text(encoding="utf-8"), re.M)
    asked = [
        line
        for line in map(Requirement, lines)
        if line.marker is None or line.marker.evaluate({"python_version": "3.11"})
    ]
    return {canonical(line.name): Version(str(line.specifier)[2:]) for line in asked}


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def required(project: dict[str, Any], *extras: str) -> list[Requirement]:
    """What the package asks for, itself left out, with these extras."""
    lines = [*project["dependencies"]]
    for extra in extras:
        lines += project["optional-dependencies"][extra]
    return [r for r in map(Requirement, lines) if r.name != project["name"]]


def test_the_version_is_one(project: dict[str, Any], repository: Path):
    citation = yaml.safe_load((repository / "CITATION.cff").read_text(encoding="utf-8"))
    assert project["dynamic"] == ["version"]
    assert suta_calib.__version__ == citation["version"] == version(project["name"])


def test_lower_bounds_are_what_the_lowest_environment_has(
    project: dict[str, Any], repository: Path
):
    lowest = pinned(repository / "constraints-lowest.txt")
    for requirement in required(project, "parquet", "dask", "vision"):
        (bound,) = (s.version for s in requirement.specifier if s.operator == ">=")
        installed = lowest[canonical(requirement.name)]
        assert installed.release[: len(Version(bound).release)] == Version(bound).release


@pytest.mark.parametrize("file", ["constraints.txt", "constraints-lowest.txt"])
def test_constraints_satisfy_every_requirement(
    file: str, project: dict[str, Any], repository: Path
):
    versions = pinned(repository / file)
    extras = ["parquet", "dask", "vision", "notebooks", "test"]
    if file == "constraints.txt":
        extras.append("docs")  # made with the newest only
    refused = [
        str(r)
        for r in required(project, *extras)
        if not r.specifier.contains(versions[canonical(r.name)])
    ]
    assert refused == []


# What conda-forge calls other than PyPI does.
CONDA_NAMES = {"pin": "pinocchio", "matplotlib": "matplotlib-base"}


def bounds(lines: list[Any]) -> set[str]:
    """Requirements as one writes them for pip or for conda, without blanks."""
    return {canonical_line(line) for line in lines if isinstance(line, str)}


def canonical_line(line: str) -> str:
    found = re.fullmatch(r"([\w.-]+)\s*(.*)", line)
    assert found is not None
    return canonical(found[1]) + found[2]


def test_conda_asks_for_what_pip_asks_for(project: dict[str, Any], repository: Path):
    wanted = {
        CONDA_NAMES.get(r.name, canonical(r.name)) + str(r.specifier) for r in required(project)
    }
    environment = yaml.safe_load((repository / "environment.yml").read_text(encoding="utf-8"))
    (from_pip,) = (d["pip"] for d in environment["dependencies"] if isinstance(d, dict))
    listed = bounds(environment["dependencies"] + from_pip)
    assert wanted <= listed
    recipe = yaml.safe_load((repository / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    assert recipe["context"]["version"] == suta_calib.__version__
    needed = bounds(recipe["requirements"]["run"])
    assert needed == wanted | {f"python{project['requires-python']}"}
    assert recipe["build"]["python"]["entry_points"] == [
        f"{name} = {target}" for name, target in project["scripts"].items()
    ]


def test_locked_are_the_versions_of_the_constraints(project: dict[str, Any], repository: Path):
    locked = pinned(repository / "requirements.lock")
    assert locked.items() <= pinned(repository / "constraints.txt").items()
    assert {canonical(r.name) for r in required(project)} <= locked.keys()


def test_no_constraint_names_an_index(repository: Path):
    for file in (*repository.glob("constraints*.txt"), repository / "requirements.lock"):
        assert "://" not in file.read_text(encoding="utf-8")


def test_no_file_names_a_package_index(repository: Path) -> None:
    """Whoever installs it has an index of their own: nothing here depends on another one."""
    hosts = re.compile("|".join([r"\bpypi" + r"\.org", "python" + "hosted"]))
    folders = ("docs", "suta_calib", ".github", "conda", "tools", "notebooks")
    files = [f for f in repository.iterdir() if f.is_file()]
    files += [f for folder in folders for f in (repository / folder).rglob("*") if f.is_file()]
    texts = {".md", ".py", ".txt", ".toml", ".yml", ".yaml", ".cff", ".ipynb", ".lock", ".cfg"}
    read = [f for f in files if f.suffix in texts and "_build" not in f.parts]
    assert [f.name for f in read if hosts.search(f.read_text(encoding="utf-8"))] == []
