"""Build what a release uploads, look at it, and install it where nothing is: `make dist`.

The wheel is installed into an empty environment of each Python that is here, with the newest
dependencies and with the oldest that are allowed. In an empty folder it runs `suta-calib demo`, and
tests from the source archive, which has no package beside them. The code is 1 if anything fails.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
MOST_MB = 5.0
# The oldest versions have no wheels for later ones.
LOWEST_ON = ("3.11", "3.12")
# They need neither a checkout nor an extra, and touch all of mathematics, files and commands.
TESTS = (
    *("geometry", "measurements", "test_api.py", "test_atomic.py", "test_inputs.py"),
    *("solver/test_descent.py", "solver/test_identifiability.py", "model/test_kinematics.py"),
    *("model/test_urdf_write_back.py", "cli/test_demo.py"),
    *("cli/test_calibrate.py", "pose_calibration/test_pivot.py", "simulation/test_simulate.py"),
)
TOOLS_OF_TESTS = ("pytest>=8.3", "hypothesis>=6.120", "packaging")
FIRST_PICTURE = "suta-calib-demo/examples/ur5_laser_tracker/results/report.html"


class DistError(Exception):
    """Something that must not be uploaded so."""


@dataclass(frozen=True)
class Trial:
    """What came of one environment; times in s on the clock."""

    python: str
    dependencies: str
    installed: float
    megabytes: float
    picture: float
    demo: float
    demo_processor: float
    tests: str

    HEAD = (
        "| Python | dependencies | install, s | MB | first picture, s | demo, s (processor) "
        "| tests |\n|---|---|--:|--:|--:|--:|---|"
    )

    def __str__(self) -> str:
        return (
            f"| {self.python} | {self.dependencies} | {self.installed:.0f} | {self.megabytes:.0f} "
            f"| {self.installed + self.picture:.0f} | {self.demo:.1f} ({self.demo_processor:.1f}) "
            f"| {self.tests} |"
        )


def run(words: Sequence[str | Path], **settings: object) -> str:
    """What a program prints; its whole output where it fails."""
    lone = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PIP_CONSTRAINT")}
    done = subprocess.run(  # type: ignore[call-overload]
        [*map(str, words)],
        env=lone,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
        **settings,
    )
    if done.returncode:
        raise DistError(f"{' '.join(map(str, words))}: exit code {done.returncode}\n{done.stdout}")
    return str(done.stdout)


def build(folder: Path) -> tuple[Path, Path]:
    """The wheel, which is built from the source archive, and that archive."""
    shutil.rmtree(folder, ignore_errors=True)
    run([sys.executable, "-m", "build", "--outdir", folder, ROOT])
    (wheel,), (archive,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, archive


def check(wheel: Path, archive: Path) -> None:
    """Whether both have what they should, and no more."""
    print(run([sys.executable, "-m", "twine", "check", "--strict", wheel, archive]).strip())
    for file in (wheel, archive):
        if (size := file.stat().st_size / 1e6) >= MOST_MB:
            raise DistError(f"{file.name}: {size:.1f} MB; expected less than {MOST_MB:g} MB")
    in_git = run(["git", "ls-files"], cwd=ROOT).splitlines()
    package = {name for name in in_git if name.startswith("suta_calib/")}
    with zipfile.ZipFile(wheel) as file:
        names = {name for name in file.namelist() if ".dist-info/" not in name}
    shipped = {name for name in names if name.startswith("suta_calib/demo/files/")}
    origins = {name.removeprefix("suta_calib/demo/files/") for name in shipped}
    if names - shipped != package or not shipped or not origins <= {*in_git}:
        odd = sorted((names - shipped) ^ package) + sorted(origins - {*in_git})
        raise DistError(f"{wheel.name}: not what git has: {odd[:9]}")
    with tarfile.open(archive) as file:
        packed = {name.partition("/")[2] for name in file.getnames()}
    wanted = package | origins | {"LICENSE", "README.md", "CHANGELOG.md", "pyproject.toml"}
    wanted |= {name for name in in_git if name.startswith("tests/")}
    if wanted - packed or packed - {*in_git} - {"PKG-INFO"}:
        odd = sorted(wanted - packed) + sorted(packed - {*in_git} - {"PKG-INFO"})
        raise DistError(f"{archive.name}: missing, or not in git: {odd[:9]}")
    for file in (wheel, archive):
        print(f"{file.name}: {file.stat().st_size / 1e6:.1f} MB")
    print(f"of the wheel {len(package)} files of the package, {len(shipped)} of the examples")


def interpreters(versions: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Pythons that are here, by version: on the path, or where pyenv keeps them."""
    for version in versions:
        candidates = [shutil.which(f"python{version}")]
        candidates += map(str, sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python3")))
        for candidate in filter(None, candidates):
            asked = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
            answer = subprocess.run(
                [candidate, "-c", asked], capture_output=True, text=True, check=False
            )
            if answer.stdout.strip() == version:
                yield version, candidate
                break
        else:
            print(f"Python {version}: not here, not tried")


def trial(version: str, python: str, wheel: Path, archive: Path, *, lowest: bool) -> Trial:
    """Install the wheel into an empty environment, run the demo and the tests."""
    with tempfile.TemporaryDirectory(prefix="suta-calib-dist-") as name:
        folder = Path(name)
        began = time.monotonic()
        run([python, "-m", "venv", folder / "env"])
        empty = megabytes(folder / "env")
        inside = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
        pip = [inside / "python", "-m", "pip", "install", "--quiet"]
        oldest = ["-c", ROOT / "constraints-lowest.txt"] if lowest else []
        run([*pip, *oldest, wheel], cwd=folder)
        installed, size = time.monotonic() - began, megabytes(folder / "env") - empty
        picture, demo, processor = timed_demo([inside / "suta-calib", "demo"], folder)
        run([*pip, *oldest, *TOOLS_OF_TESTS], cwd=folder)
        with tarfile.open(archive) as file:
            file.extractall(folder / "source", filter="data")
        (source,) = (folder / "source").iterdir()
        # What is tested is what was installed.
        shutil.rmtree(source / "suta_calib")
        tests = [f"tests/{test}" for test in TESTS]
        ended = run([inside / "python", "-m", "pytest", "-q", "-m", "not slow", *tests], cwd=source)
    dependencies = "lowest" if lowest else "newest"
    summary = ended.strip().splitlines()[-1].partition(" in ")[0]
    return Trial(version, dependencies, installed, size, picture, demo, processor, summary)


def timed_demo(words: Sequence[str | Path], folder: Path) -> tuple[float, float, float]:
    """Time to the first picture, to the end, and of the processor, s."""
    (empty := folder / "empty").mkdir()
    lone = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    before, began, picture = os.times(), time.monotonic(), None
    with (folder / "demo.txt").open("w+", encoding="utf-8") as output:
        process = subprocess.Popen(
            [*map(str, words)], cwd=empty, env=lone, stdout=output, stderr=subprocess.STDOUT
        )
        while process.poll() is None:
            if picture is None and (empty / FIRST_PICTURE).exists():
                picture = time.monotonic() - began
            time.sleep(0.02)
        ended, after = time.monotonic() - began, os.times()
        output.seek(0)
        if process.returncode or picture is None:
            raise DistError(f"{words}: exit code {process.returncode}\n{output.read()}")
    shutil.rmtree(empty)
    spent = sum(after[2:4]) - sum(before[2:4])
    return picture, ended, spent


def megabytes(folder: Path) -> float:
    """Size of all files in it, in MB."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return sum(path.stat().st_size for path in files) / 1e6


def try_runners(wheel: Path) -> None:
    """The demo without an environment of one's own, by the programs for that which are here."""
    for words in (("uvx", "--from", wheel), ("pipx", "run", "--spec", wheel)):
        if shutil.which(words[0]) is None:
            print(f"{words[0]}: not here, not tried")
            continue
        with tempfile.TemporaryDirectory(prefix="suta-calib-dist-") as name:
            picture, _, _ = timed_demo([*words, "suta-calib", "demo"], Path(name))
        print(f"{words[0]}: from nothing to the first picture {picture:.0f} s")


def main() -> int:
    """All of it; 1 where something fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    parser.add_argument("--python", nargs="*", default=PYTHONS, help="versions to try")
    parser.add_argument("--only-build", action="store_true", help="install nothing")
    given = parser.parse_args()
    try:
        wheel, archive = build(given.out)
        check(wheel, archive)
        if given.only_build:
            return 0
        try_runners(wheel)
        print(f"\n{Trial.HEAD}")
        for version, python in interpreters(given.python):
            for lowest in (False, True)[: 1 + (version in LOWEST_ON)]:
                print(trial(version, python, wheel, archive, lowest=lowest), flush=True)
    except DistError as error:
        print(f"make dist: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
