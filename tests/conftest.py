from __future__ import annotations

import gc
import os
import re
import signal
import sys
from collections.abc import Iterator
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

from blank_pictures import composed_only, drawn_for_real  # noqa: E402 (it loads NumPy)

# The same examples on every run, and no verdict that depends on how busy the machine is.
settings.register_profile("suta_calib", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("suta_calib")

# Modules that take longest, the longest first.
LONG = (
    "test_notebooks",
    "test_contract",
    "test_solve",
    "test_every_kind",
    "test_shown_blocks",
    "test_measure_sweep",
    "test_track",
    "test_picture_causes",
    "test_hand_eye_refused",
    "test_pictures",
    "test_tilt_job",
    "test_shapes",
    "test_measure",
    "test_hand_eye_frames",
    "test_several_chains",
    "test_sweep",
    "test_simulated_examples",
    "test_repeatability_suspicions",
    "test_inputs",
    "test_two_arms",
    "test_detection",
    "test_camera_view",
    "test_measure_accelerometer",
    "test_lenses",
    "test_measure_broken_off",
    "test_residual_map",
    "test_outputs",
    "test_study_runner",
    "test_lens_choice",
    "test_pivot",
    "test_picture_models",
    "test_ground_heights",
    "test_outliers",
    "test_several_eyes",
    "test_misread_pictures",
    "test_hand_eye_accuracy",
    "test_end_to_end",
    "test_repeatability",
    "test_calibrate",
    "test_between_chains",
    "test_depth",
    "test_causes",
    "test_emulated_arm",
    "test_align",
    "test_cell",
    "test_every_format",
    "test_view",
    "test_boards",
    "test_clock_job",
    "test_late_rows",
    "test_moved",
    "test_uncertainty",
    "test_balls",
    "test_docs",
    "test_weights",
    "test_hand_eye_unseen",
    "test_registration_copies",
    "test_gear_search",
    "test_scene_script",
    "test_plan",
)

# Windows has no pseudo-terminals, forks, named pipes and signals between processes: what is tested
# with these is left out there, and said.
ON_WINDOWS = sys.platform == "win32"
DEVICES = ("acquisition", "device", "emulation", "guide")
POSIX = re.compile(
    r"\b(fcntl|pty|resource|termios)\b|\bos\.(fork|geteuid|killpg|mkfifo)\b|\bSIG(INT|KILL|TERM)\b"
    r"|import .*EmulatedArm|from (device_\w+|emulated|forked_notebook|interrupted_command) import"
)


def needs_posix(path: Path) -> bool:
    """Whether a module of tests, or a folder of them, can only run on Linux and macOS."""
    if path.is_dir():
        return path.name in DEVICES
    is_test = path.name.startswith("test_") and path.suffix == ".py"
    return is_test and POSIX.search(path.read_text(encoding="utf-8")) is not None


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave out what this system lacks the means for."""
    return True if ON_WINDOWS and needs_posix(collection_path) else None


def pytest_report_header() -> list[str]:
    """Say what is left out."""
    tests = Path(__file__).parent
    left_out = [p for p in sorted(tests.rglob("*")) if ON_WINDOWS and needs_posix(p)]
    names = [p.relative_to(tests).as_posix() for p in left_out]
    return [
        f"left out on Windows, which has no pty, fork or mkfifo: {', '.join(names)}"
    ] * ON_WINDOWS


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes longest runs first, so that no process works alone at the end."""
    rank = {name: k for k, name in enumerate(LONG)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(LONG)))


def pytest_collection_finish() -> None:
    """From here on only what tests make is looked through for garbage."""
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def uncut() -> Iterator[None]:
    """No file that a test writes need outlive a power cut; a disk takes milliseconds for each.

    Tests of what is synchronised, and when, put their own in its place.
    """
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def unhurried() -> Iterator[None]:
    """No command says how long it has worked: how long that is depends on the machine.

    Tests of the lines themselves give a patience of their own.
    """
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("suta_calib.cli._output.LateProgress.patience", 600.0)
        yield


@pytest.fixture(scope="session", autouse=True)
def undrawn() -> Iterator[None]:
    """Reports have each figure composed, but not drawn.

    What is composed is ours; how Matplotlib measures and writes it takes a fourth of the time of
    the commands, and is looked at by tests that ask for `drawn`.
    """
    with composed_only():
        yield


@pytest.fixture
def drawn() -> Iterator[None]:
    """For a test that looks at a picture."""
    with drawn_for_real():
        yield


@pytest.fixture(scope="module")
def all_drawn() -> Iterator[None]:
    """For a module whose tests look at pictures, also those that its fixtures make."""
    with drawn_for_real():
        yield


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
