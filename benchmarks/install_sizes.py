"""What each extra and each large dependency costs on the disk, and to install.

Sizes are those of the packages that are installed beside this script, which `make lint` installs
with all extras, without compiled files. An extra is what comes with it beside the plain package.
Times are of the processor, of pip that gets the same versions again, without its cache, into an
empty folder; what an index and a network take comes on top. ``make dist`` has it by the clock.

Run with ``python benchmarks/install_sizes.py``; it writes ``docs/guides/installing_table.md``.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from importlib.metadata import distribution
from pathlib import Path
from typing import Final

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT: Final = Path(__file__).resolve().parents[1]
TABLE: Final = ROOT / "docs" / "guides" / "installing_table.md"
PACKAGE: Final = "suta-calib"
# For users; the rest are for who develops.
DEVELOPERS: Final = {"device", "notebooks", "bench", "test", "docs", "release", "dev"}
# Smaller ones are not named one by one, MB.
NAMED_FROM: Final = 2.0
# Direct dependencies without which something is solved all the same, and what needs them.
WEIGHED: Final = {
    "matplotlib": "pictures: in every report, and in notebooks",
    "lxml": "each URDF, with the line of every element for messages",
    "rich": "tables and progress on the console",
    "pyyaml": "every job",
    "anycrc": "`monitor`, `measure`, `guide`, `track`: frames with a checksum",
    "fpdf2": "`certificate`",
    "joblib": "`study` on several cores",
    "jinja2": "every report",
    "click": "every command",
    "pyserial": "`monitor`, `measure`, `guide`, `track`: a cable",
    "pyigtl": "`track --igtl`",
}


def brought(package: str, extras: Iterable[str] = ()) -> set[str]:
    """Everything that is installed with a package, itself included.

    Raises:
        PackageNotFoundError: some of it is not installed here.
    """
    waiting = [(canonicalize_name(package), frozenset(extras))]
    found: set[tuple[str, frozenset[str]]] = set()
    while waiting:
        name, wanted = here = waiting.pop()
        if here in found:
            continue
        found.add(here)
        for needed in map(Requirement, distribution(name).requires or ()):
            marker = needed.marker
            if marker is None or any(marker.evaluate({"extra": e}) for e in ("", *wanted)):
                waiting.append((canonicalize_name(needed.name), frozenset(needed.extras)))
    return {name for name, _ in found}


def megabytes(package: str) -> float:
    """Of its files, compiled ones left out."""
    files = (Path(str(file.locate())) for file in distribution(package).files or ())
    return sum(f.stat().st_size for f in files if f.suffix != ".pyc" and f.is_file()) / 1e6


def seconds(packages: Iterable[str]) -> float:
    """Of the processor, to install these into an empty folder."""
    versions = [f"{name}=={distribution(name).version}" for name in packages if name != PACKAGE]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-cache-dir"]
    before = os.times()
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([*pip, "--target", folder, *sorted(versions)], check=True)
    after = os.times()
    return sum(after[2:4]) - sum(before[2:4])


def row(name: str, packages: set[str]) -> str:
    """Of the table, the largest packages first."""
    sizes = {package: megabytes(package) for package in packages}
    by_size = sorted(sizes.items(), key=lambda item: -item[1])
    named = [f"{package} {size:.0f}" for package, size in by_size if size >= NAMED_FROM]
    rest = len(by_size) - len(named)
    named += [f"{rest} smaller"] * (rest > 0)
    size, taken = sum(sizes.values()), seconds(packages)
    return f"| {name} | {size:.0f} | {taken:.0f} | {', '.join(named)} |"


def weighed() -> list[str]:
    """Of the table of what would be saved: each direct dependency without which one can solve."""
    direct = [
        each for each in map(Requirement, distribution(PACKAGE).requires or ()) if not each.marker
    ]
    plain = brought(PACKAGE)
    saved = {}
    for left_out in WEIGHED:
        others = [
            brought(each.name, each.extras)
            for each in direct
            if canonicalize_name(each.name) != left_out
        ]
        gone = plain - {PACKAGE} - set().union(*others)
        saved[left_out] = sum(map(megabytes, gone))
    total = sum(map(megabytes, plain))
    return [
        f"| {name} | {size:.1f} | {size / total:.1%} | {WEIGHED[name]} |".replace("%", " %")
        for name, size in sorted(saved.items(), key=lambda item: -item[1])
    ]


def main() -> None:
    """Measure and write."""
    extras = distribution(PACKAGE).metadata.get_all("Provides-Extra") or []
    plain = brought(PACKAGE)
    rows = [row("plain", plain)]
    for extra in extras:
        if extra not in DEVELOPERS:
            rows.append(row(f"`{extra}`", brought(PACKAGE, [extra]) - plain))
    python = ".".join(map(str, sys.version_info[:2]))
    TABLE.write_text(
        f"*Python {python}, Linux, versions of `constraints.txt`; "
        "`python benchmarks/install_sizes.py` writes this table. An extra is what comes with it "
        "beside the plain package. Compiled files, some 10 % more, are not counted. Times are "
        "of the processor, for pip without its cache.*\n\n"
        "| install | MB | pip, s | of which, MB |\n|---|--:|--:|---|\n" + "\n".join(rows) + "\n\n"
        "What the plain package would be smaller by without one of these, and what is needed "
        "for it alone:\n\n| without | MB | of plain | needed by |\n|---|--:|--:|---|\n"
        + "\n".join(weighed())
        + "\n",
        encoding="utf-8",
    )
    print(TABLE.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
