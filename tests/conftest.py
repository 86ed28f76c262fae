from __future__ import annotations

import gc
import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

# Before NumPy is loaded: one thread per test process, or the parallel processes fight for the
# cores; and plots that need no display.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("MPLBACKEND", "Agg")

# A shell's background job ignores Ctrl-C, and so would every command a test starts from there.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# A test process holds a million objects that stay, modules and tests: to look through them for
# garbage as often as usual takes a fifth of the time in which tests are collected.
gc.set_threshold(50_000, 10, 10)

# The same examples on every run, and no verdict that depends on how busy the machine is.
settings.register_profile("suta_calib", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("suta_calib")

# Modules that take longest, the longest first.
LONG = (
    "test_notebooks",
    "test_every_kind",
    "test_pictures",
    "test_study_runner",
    "test_spread",
    "test_solve",
    "test_outliers",
    "test_camera_view",
    "test_hand_eye_accuracy",
    "test_outputs",
    "test_shown_blocks",
    "test_contradictions",
    "test_inputs",
    "test_study",
    "test_track",
    "test_clean_jobs",
    "test_end_to_end",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes longest runs first, so that no process works alone at the end."""
    rank = {name: k for k, name in enumerate(LONG)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(LONG)))


def pytest_collection_finish() -> None:
    """From here on only what tests make is looked through for garbage."""
    gc.freeze()


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the repository."""
    return Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared(repository: Path) -> Path:
    """Measured data kept beside the repository; the test is skipped where they are absent."""
    folder = repository.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no measured data beside the repository (../shared/data)")
    return folder


@pytest.fixture(scope="session")
def suta_urdf(repository: Path) -> Path:
    """The nominal SUTA arm."""
    return repository / "urdf" / "suta.urdf"


@pytest.fixture(scope="session")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One file that every generated example overwrites."""
    return tmp_path_factory.mktemp("generated") / "file.csv"
