"""What a script names: a job, whose samples need not exist yet, or a simulation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from suta_calib.errors import JobError
from suta_calib.job.outline import JobOutline
from suta_calib.measurements import YamlSection, read_yaml
from suta_calib.simulation import SetSpec, SimulationSpec, read_simulation


@dataclass(frozen=True, eq=False)
class ScriptFile:
    """A ``calibration.yaml`` or ``simulation.yaml``, as far as an emulated arm needs it.

    Attributes:
        path: the file.
        tip, base: ends of its arm's chain; base None for the root link.
        artefact: the artefact's file, if the script has one.
        unknowns: names and globs of the parameters a job looks for; empty for a simulation.
        simulation: the whole file, if it is a simulation.
    """

    path: Path
    tip: str
    base: str | None
    artefact: Path | None
    unknowns: tuple[str, ...]
    simulation: SimulationSpec | None = None

    def set(self, name: str | None = None) -> SetSpec:
        """One of a simulation's sets: that of this name, or the first that a tip can touch.

        Raises:
            JobError: no such set, or one that is seen from afar.
        """
        assert self.simulation is not None
        sets = {each.name: each for each in self.simulation.sets}
        touched = [n for n, each in sets.items() if each.term.medium == "touch"]
        if name is None and touched:
            return sets[touched[0]]
        if name not in touched:
            raise JobError(
                "nothing that a tip touches" if name is None else f"{name!r}",
                f"a set whose tip touches something: {', '.join(touched) or 'none here'}",
                file=self.path,
                where="sets",
            )
        return sets[name]


def read_script(path: Path) -> ScriptFile:
    """Read a script.

    Raises:
        JobError: the file cannot be read, is neither a job nor a simulation, or names an
            artefact that does not exist; names the line and the key.
    """
    path = Path(path)
    top = YamlSection(read_yaml(path, JobError), JobError)
    if "sets" in top:
        spec = read_simulation(path)
        return ScriptFile(path, spec.tip, spec.base, None, (), spec)
    if "observations" not in top:
        raise top.refuse(
            "neither a job nor a simulation",
            "'observations' as in a calibration.yaml, or 'sets' as in a simulation.yaml",
        )
    job = JobOutline.of(top)
    artefacts = (row.artefact() for row in job.rows if not row.held_out)
    artefact = next(filter(None, artefacts), None)
    return ScriptFile(path, job.tip, job.base, artefact, job.unknowns)
