"""Build what a release uploads, look at it, and install it where nothing is: `make dist`.

The wheel is installed into an empty environment of each Python that is here, with the newest
dependencies and with the oldest that are allowed. In an empty folder it runs `suta-calib demo`, and
tests from the source archive, which has no package beside them. What fails is told at the end, with
its whole output, and stops nothing else. The code is 1 if anything fails.
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
# Of the demo, in time of the processor: 8 to 10 s were measured, by what else the machine does.
MOST_SECONDS = 15.0
# They need neither a checkout nor an extra, and touch all of mathematics, files and commands.
TESTS = (
    *("geometry", "measurements", "test_api.py", "test_atomic.py", "test_inputs.py"),
    *("solver/test_descent.py", "solver/test_identifiability.py", "model/test_kinematics.py"),
    *("model/test_urdf_write_back.py", "cli/test_demo.py"),
    *("cli/test_calibrate.py", "pose_calibration/test_pivot.py", "simulation/test_simulate.py"),
)
TOOLS_OF_TESTS = ("pytest>=8.3", "hypothesis>=6.120", "packaging")
SCHEMA = ("check-jsonschema", "--builtin-schema")
# What no test runs: the linter's words, and the files that it gets.
LINTERS = (
    ((*SCHEMA, "vendor.github-workflows"), ".github/workflows/*"),
    ((*SCHEMA, "vendor.dependabot"), ".github/dependabot.yml"),
    ((*SCHEMA, "vendor.github-issue-config"), ".github/ISSUE_TEMPLATE/config.yml"),
    ((*SCHEMA, "vendor.github-issue-forms"), ".github/ISSUE_TEMPLATE/[!c]*.yml"),
    ((*SCHEMA, "vendor.citation-file-format"), "CITATION.cff"),
    (("hadolint",), "Dockerfile"),
    (("actionlint",), ".github/workflows/*"),
)
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
    failed: str = ""

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


def found(program: str) -> str | None:
    """Where a program is: beside this Python, or on the path."""
    return shutil.which(
        program, path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    )


def lint() -> None:
    """What is run elsewhere, by GitHub and Docker, against its rules."""
    for words, pattern in LINTERS:
        program = found(words[0])
        if program is None:
            print(f"{words[0]} {pattern}: not here, not tried")
            continue
        run([program, *words[1:], *sorted(ROOT.glob(pattern))])
        print(f"{words[0]} {pattern}: passed")


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
        try:
            ended, failed = (
                run(
                    [inside / "python", "-m", "pytest", "-q", "-m", "not slow", *tests], cwd=source
                ),
                "",
            )
        except DistError as error:
            ended = failed = str(error)
    if processor > MOST_SECONDS:
        failed += f"suta-calib demo took {processor:.1f} s; expected {MOST_SECONDS:g} s at most"
    dependencies = "lowest" if lowest else "newest"
    summary = ended.strip().splitlines()[-1].partition(" in ")[0]
    return Trial(version, dependencies, installed, size, picture, demo, processor, summary, failed)


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


def try_runner(words: Sequence[str]) -> None:
    """The demo without an environment of one's own, by a program for that."""
    program = found(words[0])
    if program is None:
        print(f"{words[0]}: not here, not tried")
        return
    with tempfile.TemporaryDirectory(prefix="suta-calib-dist-") as name:
        picture, _, _ = timed_demo([program, *words[1:], "suta-calib", "demo"], Path(name))
    print(f"{words[0]}: from nothing to the first picture {picture:.0f} s", flush=True)


def main() -> int:
    """All of it; 1 where something fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    parser.add_argument("--python", nargs="*", default=PYTHONS, help="versions to try")
    parser.add_argument("--only-build", action="store_true", help="install nothing")
    given = parser.parse_args()
    failures: list[str] = []
    try:
        lint()
        wheel, archive = build(given.out)
        check(wheel, archive)
    except DistError as error:
        print(f"make dist: {error}", file=sys.stderr)
        return 1
    if given.only_build:
        return 0
    for words in (("uvx", "--from", str(wheel)), ("pipx", "run", "--spec", str(wheel))):
        try:
            try_runner(words)
        except DistError as error:
            failures.append(f"{words[0]}: {error}")
    print(f"\n{Trial.HEAD}")
    for version, python in interpreters(given.python):
        for lowest in (False, True):
            where = f"Python {version}, {'lowest' if lowest else 'newest'} dependencies"
            try:
                row = trial(version, python, wheel, archive, lowest=lowest)
            except DistError as error:
                failures.append(f"{where}: {error}")
                continue
            print(row, flush=True)
            if row.failed:
                failures.append(f"{where}: {row.failed}")
    for failure in failures:
        print(f"\nmake dist: {failure}", file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
