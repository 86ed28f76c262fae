"""An emulated arm from options: its device, its truth, its motion; and playing it on a port."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.device.device_file import device_text
from suta_calib.display import Displayable
from suta_calib.emulation.accelerometer import COLUMNS, accelerometer
from suta_calib.emulation.by_hand import HandSweep, swept_by_hand
from suta_calib.emulation.faults import Faults
from suta_calib.emulation.motion import Motion, Still, Stops, continuous
from suta_calib.emulation.player import Played, Player
from suta_calib.emulation.script import (
    PLACE_FORM,
    SEATING,
    Timing,
    artefact_set,
    placement_within_reach,
    point_set,
    read_script,
    stops,
)
from suta_calib.emulation.stream import EMULATED, Emulation, device_of
from suta_calib.emulation.terminal import PseudoTerminal
from suta_calib.emulation.trajectories import parse_posture, pivoting, posture_of, recorded, sweep
from suta_calib.emulation.truth import (
    drawn_truth,
    nominal_values,
    read_truth,
    truth_text,
    write_trajectory,
)
from suta_calib.errors import InputError, JobError, did_you_mean
from suta_calib.inputs import UrdfFile
from suta_calib.job.outline import JobOutline
from suta_calib.measurements import write_text
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import (
    InverseKinematics,
    NoiseLevels,
    PoseSpec,
    SetSpec,
    SimulationSpec,
)
from suta_calib.simulation.noise import full_circle, stream
from suta_calib.simulation.schema import PostureRow
from suta_calib.units import from_deg

# Motions with the tip on a place, as a hand makes them.
_BY_HAND: Final = ("socket", "plate")
# A place by its label: where it is, or None for where a simulation or a search puts it.
Places = Mapping[str, PoseSpec | None]


@dataclass(frozen=True, eq=False)
class EmulationOptions(Displayable):
    """What is emulated, in SI units; a script, or one of the free motions.

    Attributes:
        urdf: the nominal arm.
        tip, base: ends of its chain; those of the script by default.
        rate: frames per second, Hz.
        script: a calibration.yaml or simulation.yaml whose landmarks or points are rested on.
        motion: without a script: ``still``, ``pivot``, ``trajectory``, or ``postures``: rests in
            random ones; ``socket`` or ``plate``: swept by hand with the tip in a socket or on a
            plate.
        set_name: which set of a simulation; the first by default.
        placements: where the artefact stands, by label.
        points: fixed points by label: to be touched (script) or pivoted on.
        sequence: landmarks in order; as in the artefact by default.
        repeats: how often each placement is gone through.
        directions: rests on each fixed point, or in postures.
        timing: of rests and of the motions between them.
        seating: noise per axis, m; the script's by default.
        posture: where it rests or starts, or a search does: ``joint_1=15,joint_3=160`` in degrees
            and mm; the middle of the ranges by default.
        cone: largest tilt, rad.
        period: of a pivoting, s.
        amplitude: of swings, rad.
        frequency: of swings at the start and at the end, Hz.
        size: edge of the square on the plate, m.
        duration: of the swings, or of the sweep, s.
        chain: of several chains of the script's robot the one that is emulated.
        csv: a trajectory: time (s) and every joint (rad).
        truth: true parameters: a truth.yaml, or a simulation.yaml for its errors.
        errors_seed: draws the true parameters.
        seed: of noise, seating and faults.
        encoder: noise of a reading, rad.
        accelerometer: (3, 3) how one is turned in the tip's link that is sent too; None for none.
        accelerometer_noise: standard deviation of its direction, rad.
        form, unit, counts_per_turn, signs, baudrate: of the device; see `device_of`.
        faults: what goes wrong.
    """

    urdf: UrdfFile
    tip: str | None = None
    base: str | None = None
    rate: float = 768.0
    script: Path | None = None
    motion: Literal["still", "pivot", "trajectory", "postures", "socket", "plate"] | None = None
    set_name: str | None = None
    placements: Places = field(default_factory=dict)
    points: Places = field(default_factory=dict)
    sequence: tuple[str, ...] = ()
    repeats: int | None = None
    directions: int | None = None
    timing: Timing = field(default_factory=Timing)
    seating: float | None = None
    posture: str = ""
    cone: float = from_deg(30.0)
    period: float = 40.0
    amplitude: float = from_deg(20.0)
    frequency: tuple[float, float] = (0.05, 0.5)
    size: float = 0.15
    duration: float = 60.0
    chain: str = ""
    csv: Path | None = None
    truth: Path | None = None
    errors_seed: int | None = None
    seed: int = 0
    encoder: float = from_deg(0.001)
    accelerometer: FloatArray | None = None
    accelerometer_noise: float = from_deg(0.2)
    form: str = "frames"
    unit: str = "counts"
    counts_per_turn: int = 1 << 22
    signs: tuple[int, ...] = ()
    baudrate: int = 921600
    faults: Faults = field(default_factory=Faults)


@dataclass(frozen=True)
class PlayOptions(Displayable):
    """How an emulated arm is played, and what it leaves behind.

    Attributes:
        link: symbolic link that is kept to the port.
        seconds: how long at most, waiting included, s.
        wait: for somebody to open the port before anything moves.
        gated: whether the arm waits between placements; see `RoundClock`.
        device_out: where the device.yaml goes to read it with.
        truth_out: where the truth goes (YAML), to judge a result by.
        trajectory_out: where the true tip poses go (CSV) at the end.
    """

    link: Path | None = None
    seconds: float = math.inf
    wait: bool = True
    gated: bool = True
    device_out: Path | None = None
    truth_out: Path | None = None
    trajectory_out: Path | None = None


@dataclass(frozen=True, eq=False)
class EmulatedDevice(Displayable):
    """An emulated arm, and the truth behind it.

    Attributes:
        arm: the nominal arm.
        values: its true parameters, m or rad.
        plan: what a script touches.
        emulation: what it sends; its device has no port yet.
    """

    arm: ArmModel
    values: dict[str, float]
    plan: SetSpec | None
    emulation: Emulation

    def __str__(self) -> str:
        emulation, motion = self.emulation, self.emulation.motion
        text = f"{len(emulation.device.joints)} joints at {emulation.rate:g} Hz"
        if isinstance(motion, Stops):
            rounds = len(motion.rounds)
            text += f", {len(motion.labels)} rests in {rounds} round{'s' * (rounds != 1)}"
        departing = sum(v != self.arm.parameters[n].nominal for n, v in self.values.items())
        return f"{text}; {departing} true parameters differ from the URDF"

    def play(
        self,
        options: PlayOptions,
        *,
        announce: Callable[[str], None] = print,
        say: Callable[[str], None] = print,
        stopped: Callable[[], bool] = lambda: False,
    ) -> Played:
        """Send frames on a pseudo-terminal, in real time, until the time is up.

        Args:
            options: how, and what is left behind.
            announce: given the name of the port once it is there.
            say: told what happens.
            stopped: whether somebody asks to stop.

        Returns:
            What was sent.

        Raises:
            InputError: a port that shall vanish without a link.
            OutputError: a file or link that cannot be made.
        """
        emulation, arm, values = self.emulation, self.arm, self.values
        if emulation.faults.absences and options.link is None:
            raise InputError(
                "a port that disappears and comes back under another name",
                "--link PATH, a link that always points to the port",
                where="--faults",
            )
        with PseudoTerminal(options.link) as terminal:
            if options.device_out is not None:
                device = replace(emulation.device, port=str(Path(terminal.port).absolute()))
                write_text(options.device_out, device_text(device, EMULATED))
            if options.truth_out is not None:
                truth = truth_text(arm, values, emulation.seed, self.plan, emulation.motion)
                write_text(options.truth_out, truth)
            announce(terminal.name)
            say(str(self))
            out = options.trajectory_out
            player = Player(emulation, terminal, say, gated=options.gated, recorded=out is not None)
            try:
                player.run(options.seconds, stopped, wait=options.wait)
            finally:
                say(str(player.played))
                if out is not None:
                    write_trajectory(out, arm, values, player.trajectory, emulation.motion)
        return player.played


def emulated_device(options: EmulationOptions) -> EmulatedDevice:
    """The emulated arm that the options describe.

    Raises:
        InputError: options that contradict each other, or a file that cannot be used.
    """
    if options.script is not None and (options.motion or options.csv):
        raise InputError("--script together with --motion or --csv", "only one of them")
    if options.csv is not None and options.motion not in (None, "trajectory"):
        raise InputError(f"--csv together with --motion {options.motion}", "--motion trajectory")
    if options.script is None and options.placements:
        raise InputError(
            "--placement without --script", "--script, the job whose artefact is placed there"
        )
    if options.script is None and options.points and options.motion not in ("pivot", *_BY_HAND):
        expected = f"--script, or --motion {' or '.join(('pivot', *_BY_HAND))}"
        raise InputError("--point without --script", expected)
    if (options.faults.lifts or options.faults.slips) and options.motion not in _BY_HAND:
        expected = f"--motion {' or '.join(_BY_HAND)}"
        raise InputError("a tip that lifts or a place that slips", expected, where="--faults")
    script = None if options.script is None else read_script(options.script)
    tip, base = options.tip, options.base
    if tip is None:
        if script is None:
            raise InputError("no tip", "--tip FRAME, the link or frame whose pose matters")
        ends = script.arm if isinstance(script, SimulationSpec) else script
        tip, its_base = ends.one(options.chain)
        base = base or its_base
    arm = ArmModel.from_urdf(options.urdf, tip, base)
    device = device_of(
        arm,
        form=options.form,
        unit=options.unit,
        counts_per_turn=options.counts_per_turn,
        signs=options.signs,
        baudrate=options.baudrate,
        extra_columns=() if options.accelerometer is None else COLUMNS,
    )
    options.faults.check_joints(device.names)
    values = _values(options, script, arm)
    plan = None
    if isinstance(script, SimulationSpec):
        plan = _set(options, script)
    elif script is not None:
        plan = _job_plan(options, script, arm, values)
    if script is None or plan is None:
        motion = _free_motion(options, arm, values)
    else:
        motion = _script_motion(options, script, arm, values, plan)
    extra = None
    if options.accelerometer is not None:
        extra = accelerometer(
            *(arm, values, motion),
            mounting=options.accelerometer,
            noise=options.accelerometer_noise,
            seed=options.seed,
        )
    emulation = Emulation(
        *(device, motion, options.rate, options.encoder, options.faults, options.seed), extra=extra
    )
    return EmulatedDevice(arm, values, plan, emulation)


def _values(
    options: EmulationOptions, script: JobOutline | SimulationSpec | None, arm: ArmModel
) -> dict[str, float]:
    seed = options.errors_seed
    if options.truth is not None:
        return read_truth(options.truth, arm, seed)
    if isinstance(script, SimulationSpec):
        return read_truth(script.path, arm, seed)
    if seed is None:
        return nominal_values(arm)
    return drawn_truth(arm, seed, () if script is None else script.unknowns)


def _set(options: EmulationOptions, script: SimulationSpec) -> SetSpec:
    """A set of a simulation that a tip can touch, with what the options change of it."""
    touched = {
        item.name: item
        for item in script.sets
        if item.term.medium == "touch" and options.chain in ("", item.chain)
    }
    name = options.set_name or next(iter(touched), "")
    if name not in touched:
        raise JobError(
            repr(name) if name else "no observation with touches",
            f"a set in which the tip touches something: {', '.join(touched) or 'none here'}",
            file=script.path,
            where="sets",
        )
    plan = touched[name]
    noise = plan.noise
    if options.seating is not None:
        noise = replace(noise, seating=options.seating)
    if plan.term.needs_artefact:
        places = _places(options.placements, plan.places, "--placement")
    else:
        places = _places(options.points, plan.places, "--point")
    repeats = options.repeats or plan.repeats
    directions = options.directions or plan.directions
    return replace(plan, noise=noise, places=places, repeats=repeats, directions=directions)


def _job_plan(
    options: EmulationOptions, job: JobOutline, arm: ArmModel, values: dict[str, float]
) -> SetSpec:
    """What a job's arm shall touch: the job itself does not say where anything stands."""
    noise = SEATING if options.seating is None else NoiseLevels(seating=options.seating)
    if options.points:
        points = _places(options.points, {}, "--point")
        directions = options.directions or SetSpec.directions
        return point_set(points, directions, options.cone, noise)
    artefacts = (
        row.artefact() for row in job.rows if not row.held_out and options.chain in ("", row.chain)
    )
    if (artefact := next(filter(None, artefacts), None)) is None:
        raise InputError(
            "no artefact in the job",
            "--point F1=x,y,z of a fixed point, in mm in the base frame",
            file=options.script,
        )
    posture = posture_of(arm, parse_posture(arm, options.posture))
    placements = {}
    for label, pose in (options.placements or {"P1": None}).items():
        placements[label] = pose or placement_within_reach(
            arm, values, artefact, label, seed=options.seed, posture=posture
        )
    return artefact_set(artefact, placements, options.repeats or 1, noise)


def _places(
    requested: Places, available: Mapping[str, PoseSpec], where: str
) -> dict[str, PoseSpec]:
    """The places asked for, by label from those known or with a pose; those known by default."""
    chosen: dict[str, PoseSpec] = {}
    for label, pose in requested.items():
        if pose is None and label not in available:
            expected = f"one of {', '.join(available)}" if available else PLACE_FORM
            raise InputError(
                repr(label), expected, where=where, hint=did_you_mean(label, available)
            )
        chosen[label] = available[label] if pose is None else pose
    return chosen or dict(available)


def _script_motion(
    options: EmulationOptions,
    script: JobOutline | SimulationSpec,
    arm: ArmModel,
    values: dict[str, float],
    plan: SetSpec,
) -> Motion:
    posture = script.posture if isinstance(script, SimulationSpec) else ()
    # Checked here too: below, a wrong joint would be blamed on the script's file.
    given = parse_posture(arm, options.posture)
    posture_of(arm, given)
    posture += tuple(PostureRow(name, q, arm.units[name]) for name, q in given.items())
    return stops(
        arm,
        values,
        plan,
        seed=options.seed,
        sequence=options.sequence,
        posture=posture,
        timing=options.timing,
        path=options.script,
    )


def _free_motion(options: EmulationOptions, arm: ArmModel, values: dict[str, float]) -> Motion:
    if options.csv is not None:
        return recorded(options.csv, arm)
    posture = posture_of(arm, parse_posture(arm, options.posture))
    if options.motion in ("pivot", *_BY_HAND):
        places = [*_places(options.points, {}, "--point").values()]
        if len(places) > 1:
            raise InputError(f"{len(places)} points", "one to pivot on", where="--point")
        point = np.array(places[0].position) if places else None
        begin = posture if options.posture else None
        if options.motion in _BY_HAND:
            how = HandSweep(
                cone=options.cone,
                size=options.size if options.motion == "plate" else 0.0,
                duration=options.duration,
                seating=SEATING.seating if options.seating is None else options.seating,
                lifts=options.faults.lifts,
                slips=options.faults.slips,
            )
            upright = places[0].rotation if places else None
            return swept_by_hand(
                *(arm, values, how),
                posture=begin,
                point=point,
                upright=upright,
                seed=options.seed,
            )
        return pivoting(
            arm,
            values,
            point,
            posture=begin,
            cone=options.cone,
            period=options.period,
            seed=options.seed,
        )
    if options.motion == "postures":
        rng = stream(options.seed, "postures")
        count = options.directions or SetSpec.directions
        postures = InverseKinematics(arm, values).random_readings(rng, count)
        if options.posture:
            postures[0] = posture
        where, timing = continuous(postures, full_circle(arm)), options.timing
        return Stops(where, ({},) * count, timing.rest, timing.move, (count - 1,))
    if options.motion == "trajectory":
        return sweep(arm, posture, options.amplitude, *options.frequency, duration=options.duration)
    return Still(posture)
