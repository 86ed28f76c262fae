"""One scene for all tests of this folder, and what becomes of a command line."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest
from hostile_scene import write_scene


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory, suta_urdf: Path) -> Path:
    """What the commands read; whoever spoils a file of it puts it back."""
    path = write_scene(tmp_path_factory.mktemp("hostile") / "scene", suta_urdf)
    # Without its samples the folder is not empty: there nothing would be meant to be held out.
    (path / "validation" / "notes.txt").write_text("a rainy day\n")
    return path


@pytest.fixture(autouse=True)
def told() -> Iterator[None]:
    """Warnings are lines on stderr here."""
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        yield
