"""How often the intervals of a certificate hold the truth. Simulated.

``python benchmarks/coverage.py [CASE ...] [--answers N] [--processes N] [--only-print]``

Every case simulates measurements with known truth, computes the answer as its command does, and
counts how often value ± U holds the truth, with U = k times the standard uncertainty as the
certificate states it. What is stated beforehand (the scale of a tracker, the file of a camera) is
drawn anew for every answer from the distribution that is stated. All answers count, whatever their
verdict; those that are refused are named. Figures stay in ``results/coverage.json``, so that a case
can run alone; ``docs/guides/certificate_coverage_table.md`` is written anew from all of them.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed
from rich.console import Console

from suta_calib import SutaCalibError

ROOT: Final = Path(__file__).parents[1]
FIGURES: Final = ROOT / "benchmarks" / "results" / "coverage.json"
PAGE: Final = ROOT / "docs" / "guides" / "certificate_coverage_table.md"
# The scenes of the tests.
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "support")]
from certified_answers import CASES, Case, Held  # noqa: E402


def counted(case: Case, answers: int, processes: int) -> dict[str, Any]:
    """Shares of quantities inside, with twice the counting error; what was refused."""
    begun = time.monotonic()
    with Parallel(n_jobs=processes, return_as="generator") as parallel:
        results = list(parallel(delayed(_one)(case, seed) for seed in range(answers)))
    by_answer = defaultdict[str, list[float]](list)
    for held in results:
        for name, inside in (held or {}).items():
            by_answer[name].append(float(np.mean(inside)))
    return {
        "answers": answers,
        "refused": sum(held is None for held in results),
        "seconds": time.monotonic() - begun,
        "held": {
            name: {
                "pct": 100.0 * float(np.mean(shares)),
                # Coordinates of one answer share its errors: an answer is what is counted.
                "counting_pct": 200.0 * float(np.std(shares, ddof=1)) / math.sqrt(len(shares)),
            }
            for name, shares in by_answer.items()
        },
    }


def _one(case: Case, seed: int) -> Held | None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return case.answer(seed)
        except SutaCalibError:
            return None


def page(figures: Mapping[str, Any]) -> str:
    """The table of the guide."""
    return "\n".join(
        [
            "*Simulated; `python benchmarks/coverage.py` counts and writes this table. 95.45 % are "
            "asked for; ± is twice the counting error, by answers.*",
            "",
            "| command | simulated data | answers | quantity | inside, % |",
            "|---|---|--:|---|--:|",
            *(row for name, case in CASES.items() for row in _rows(case, figures.get(name))),
            "",
        ]
    )


def _rows(case: Case, found: Mapping[str, Any] | None) -> Iterator[str]:
    if found is None:
        return
    refused = f" ({found['refused']} refused)" if found["refused"] else ""
    for name, share in found["held"].items():
        yield (
            f"| `{case.command}` | {case.data} | {found['answers']:,}{refused} | {name} | "
            f"{share['pct']:.1f} ± {share['counting_pct']:.1f} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}")
    parser.add_argument("--answers", type=int, help="of every case; as the table has them")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--only-print", action="store_true", help="write no file")
    options = parser.parse_args()
    if unknown := set(options.cases) - set(CASES):
        parser.error(f"found {', '.join(sorted(unknown))}; expected some of {', '.join(CASES)}")
    for name in options.cases or CASES:
        case = CASES[name]
        found = counted(case, options.answers or case.answers, options.processes)
        Console().print(*_rows(case, found), f"{found['seconds']:.0f} s", sep="\n", soft_wrap=True)
        if not options.only_print:
            figures = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.is_file() else {}
            figures[name] = {key: value for key, value in found.items() if key != "seconds"}
            FIGURES.write_text(
                json.dumps({key: figures[key] for key in CASES if key in figures}, indent=1) + "\n",
                encoding="utf-8",
            )
            PAGE.write_text(page(figures), encoding="utf-8")


if __name__ == "__main__":
    main()
