"""``suta-calib simulate``: samples of an arm whose true geometry is known."""

from __future__ import annotations

import json
from pathlib import Path

import click

from suta_calib.cli._options import PATH, Folder, flag, option
from suta_calib.cli._output import LateProgress
from suta_calib.simulation import read_simulation, still_empty, write_simulation
from suta_calib.simulation import simulate as run


@click.command()
@click.argument("simulation", type=PATH, metavar="SIMULATION.yaml")
@option("--out", "Folder for the simulated files.", Folder(), required=True)
@option("--seed", "Seed, instead of the one in the file.", click.IntRange(min=0))
@flag("--json", "Print one JSON object.", name="as_json")
def simulate(simulation: Path, out: Path, seed: int | None, as_json: bool) -> None:
    """Simulate the measurements that SIMULATION.yaml describes, and write their true values."""
    spec = read_simulation(simulation)
    with LateProgress("simulating") as progress:
        made = run(spec, seed, lambda path: progress.about(f"simulating {path}"))
    removed = still_empty(made, out)
    write_simulation(made, out)
    files = [
        {"file": file.path, "samples": len(file.samples), "outliers": len(file.outliers)}
        for file in made.files
    ]
    if as_json:
        answer = {"status": "simulated", "seed": made.seed, "out": str(out), "files": files}
        click.echo(json.dumps(answer | ({"removed": [*map(str, removed)]} if removed else {})))
        return
    for path in removed:
        click.echo(f"removed {path}, which contained only a header")
    total = sum(len(file.samples) for file in made.files)
    wrong = sum(len(file.outliers) for file in made.files)
    click.echo(
        f"{total} simulated samples in {len(files)} files, {wrong} of them outliers (seed "
        f"{made.seed}); the true values are in {out}/truth.yaml"
    )
