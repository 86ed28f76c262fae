"""``suta-calib simulate``: samples of an arm whose true geometry is known."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Final

import click
from rich.console import Console

from suta_calib.simulation import Simulation, read_simulation, write_simulation
from suta_calib.simulation import simulate as run

# Shorter runs are over before anybody wonders.
_PATIENCE_S: Final = 2.0


@click.command()
@click.argument("simulation", type=click.Path(path_type=Path), metavar="SIMULATION.yaml")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder to write into.")
@click.option("--seed", type=click.IntRange(min=0), help="In place of the file's own seed.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def simulate(simulation: Path, out: Path, seed: int | None, as_json: bool) -> None:
    """Simulate measurements as SIMULATION.yaml describes them, and the truth behind them."""
    spec = read_simulation(simulation)
    began = time.monotonic()
    with Console(stderr=True).status("") as status:
        status.stop()

        def progress(path: str) -> None:
            status.update(f"simulating {path}")
            if time.monotonic() - began > _PATIENCE_S:
                status.start()

        made = run(spec, seed, progress)
    write_simulation(made, out)
    summary = _summary(made, out)
    click.echo(json.dumps(summary) if as_json else _sentence(summary))


def _summary(made: Simulation, out: Path) -> dict[str, object]:
    files = [
        {"file": file.path, "samples": len(file.samples), "outliers": len(file.outliers)}
        for file in made.files
    ]
    return {"status": "simulated", "seed": made.seed, "out": str(out), "files": files}


def _sentence(summary: dict[str, object]) -> str:
    files = summary["files"]
    assert isinstance(files, list)
    total, wrong = (sum(file[key] for file in files) for key in ("samples", "outliers"))
    return (
        f"{total} simulated samples in {len(files)} files, {wrong} of them outliers "
        f"(seed {summary['seed']}); the truth is in {summary['out']}/truth.yaml"
    )
