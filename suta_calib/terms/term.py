"""What every kind of observation has in common.

A term says what its samples must satisfy. Its author writes the residual of one row as a function
of one or more tool poses, the term's own unknowns and the row's data; a closed-form start for those
unknowns; and what an ideal measurement would have been (`Term.observed`). Jacobians, robust
weights, uncertainty and reports follow from the first two, simulations from the last.

Everything else that somebody must know of a kind (what it needs, its columns and keys, how its
samples group, the words for it) is a class attribute: job files, `init`, simulations, searches for
outliers, plans, guided measuring and explanations ask the kind, and name none.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Level
from suta_calib.errors import SamplesError
from suta_calib.measurements import Artefact, Board, SampleColumns, YamlSection
from suta_calib.measurements.fields import Field, Fields
from suta_calib.measurements.samples import STROKE
from suta_calib.measurements.scale import INSTRUMENT_PPM, PPM, LengthScale
from suta_calib.model.parameters import End, Parameter
from suta_calib.terms.block import Block, first_of_each, joined, numbered, same_touches
from suta_calib.terms.clock import TimeOffset, clocked
from suta_calib.terms.external_frame import ExternalFrame, frames_of
from suta_calib.terms.from_arrays import FromArrays
from suta_calib.terms.given_places import GivenPlaces
from suta_calib.terms.given_pose import GivenPose
from suta_calib.terms.observed import Observed, Resimulation, TrueFrame
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.terms.setup import Setup
from suta_calib.units import Unit

# What tells where the arm is: its tip touches something, an instrument sees the tip, or a camera
# on the tip sees something.
Medium = Literal["touch", "instrument", "camera"]
# Motions that observations may leave open: of the whole arm in the base, of the tip along the tool,
# of all that is touched at one place.
Gap = Literal["base", "tool", "place"]


@dataclass(frozen=True, eq=False)
class Mount:
    """Where what is seen sits in the tip.

    Attributes:
        rotation: (3, 3); None where no orientation was seen.
        position: (3,), m.
    """

    rotation: FloatArray | None
    position: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Term(GivenPlaces):
    """One set of observations of one kind.

    Attributes:
        kind: its name in files.
        order: its place among the kinds that are offered; of a sort, the first is taken.
        about: what was measured, for whoever starts a job: follows the kind's name and a colon.
        columns: what its samples hold beside the joints.
        medium: what tells where the arm is.
        needs_artefact: whether an artefact is touched.
        between_chains: whether it is about the tips of two chains, so that it helps no lone arm.
        has_angles: whether it looks at orientations, so that their noise means something.
        keys: what else a row of a job may say, read by `read_settings`.
        unit: of the noise of its first block in a job: ``mm``, or ``px`` where lengths are in
            pictures; ``deg`` of angles alone, empty of plain numbers.
        place: label column of what stands somewhere unknown and is touched; empty where nothing is.
        place_unknown: name of the unknowns of one such place, before its label in brackets.
        place_more: names of what else is unknown of it, before its label in brackets.
        place_turns: whether such a place has an orientation.
        place_needs_turn: whether its orientation is everything of it, so that a given pose says it.
        mark: label column, that may be left out, of what is seen on the tip's link; its unknowns
            carry the same name. Empty for kinds that look at nothing but the tip.
        sent: columns of numbers that a device may send beside its joints; `measure` averages them
            at each rest. Empty where nothing but what is touched or seen is measured.
        groupings: what its samples can be grouped by: what one group is called, and the label
            columns whose values, joined by a slash, name it; none for every row by itself.
        noise_factor: standard deviation of a component of the first block, over that of one
            coordinate of one touch.
        simulation_keys: what else a set of a simulation may say, read by `read_settings`.
        measured_keys: keys of a row about what was measured, which a simulation does not take.
        frames: what a simulation may state of what sees or is seen.
        assumed_scale: of the lengths that its instrument measures, where nobody says it; by default
            that of a good one.
        chance: rough part of an arm's postures in which what is looked at is in sight.
        assumptions_key: what a job's row says for `with_assumptions_estimated`.
        files: what the files that a job names are begun with; each is called as its key.
        begun: lines of a new job below its row, as comments: keys that few rows need.
        tested: what of an acceptance test after ISO 10360-12 its samples measure.
        leaves_open: by what is left open, why this kind alone cannot tell, and what to do then.
        tells: by what others leave open, how this kind tells it: an advice.
        poses: where the tool poses come from.
        given: what is known beforehand of where things stand, by the label of a place or a mark or
            the key of a frame; an empty one for the only place there is, or for what sees.
        scale: how well the scale of lengths is known that an instrument measures, where a job
            says so; see `length_scale.scale_carrier`.
        time_offset: what is known of the clock of what sees a moving arm, where that is not the
            clock of the readings; any kind but those that touch may have it.
    """

    kind: ClassVar[str]
    order: ClassVar[int] = 100
    about: ClassVar[str]
    columns: ClassVar[SampleColumns]
    medium: ClassVar[Medium] = "touch"
    needs_artefact: ClassVar[bool] = False
    between_chains: ClassVar[bool] = False
    has_angles: ClassVar[bool] = True
    keys: ClassVar[tuple[Field, ...]] = ()
    unit: ClassVar[Literal["mm", "px", "deg", ""]] = "mm"
    place: ClassVar[str] = ""
    place_unknown: ClassVar[str] = ""
    place_more: ClassVar[tuple[str, ...]] = ()
    place_turns: ClassVar[bool] = True
    place_needs_turn: ClassVar[bool] = False
    mark: ClassVar[str] = ""
    sent: ClassVar[tuple[str, ...]] = ()
    groupings: ClassVar[Mapping[str, tuple[str, ...]]] = {"row": ()}
    noise_factor: ClassVar[float] = 1.0
    simulation_keys: ClassVar[tuple[Field, ...]] = ()
    measured_keys: ClassVar[tuple[str, ...]] = ()
    frames: ClassVar[tuple[TrueFrame, ...]] = ()
    assumed_scale: ClassVar[LengthScale] = LengthScale(INSTRUMENT_PPM * PPM)
    chance: ClassVar[float] = 1.0
    assumptions_key: ClassVar[str] = ""
    files: ClassVar[Mapping[str, str]] = {}
    begun: ClassVar[Sequence[str]] = ()
    tested: ClassVar[Literal["", "length", "articulation"]] = ""
    leaves_open: ClassVar[Mapping[Gap, tuple[str, str]]] = {}
    tells: ClassVar[Mapping[Gap, str]] = {}

    poses: PoseSource
    given: Mapping[str, GivenPose] = field(default_factory=dict, kw_only=True)
    scale: LengthScale | None = field(default=None, kw_only=True)
    time_offset: TimeOffset | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if self.time_offset is not None:
            if self.medium == "touch":
                hint = "an arm rests where it touches"
                raise self.refuse("a time offset", "none", hint)
            name = self._clock(self.time_offset).name
            poses = clocked(self.poses, name, self.clock_reach)
            object.__setattr__(self, "poses", poses)
        # What cannot be used is refused where the term is made, not where it is first looked at.
        _ = self.blocks

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.poses)} samples>"

    def __getstate__(self) -> dict[str, Any]:
        """What it was made of: all else follows, residuals too, which may be a `lambda`."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def refuse(cls, found: str, expected: str, hint: str = "") -> SamplesError:
        """Error about samples of this kind, to be raised by the caller."""
        return SamplesError(found, expected, where=cls.kind, hint=hint)

    @property
    @abstractmethod
    def blocks(self) -> tuple[Block, ...]:
        """Its residuals: of lengths first, then of angles where there are any."""

    @property
    def of_chain(self) -> str:
        """``of chain left`` or ``of link forearm``, of several chains; empty elsewhere."""
        name = self.poses.label("default", "tip")
        return "" if name == "default" else f" of {self.poses.sort_of_chain} {name}"

    @property
    def called(self) -> str:
        """Its kind in words, and its chain where there are several."""
        return self.kind.replace("_", " ") + self.of_chain

    @property
    def error_unit(self) -> Unit:
        """Unit of the errors that it is judged by: those of its first block."""
        return self.blocks[0].unit

    @classmethod
    def measures_lengths(cls) -> bool:
        """Whether an instrument of this kind measures positions or lengths."""
        return cls.columns.position or any(number.unit == "m" for number in cls.columns.numbers)

    @classmethod
    def over(cls, poses: PoseSource, setup: Setup) -> Self:
        """Build the term from what a row of a job says: as many of its attributes as it has."""
        values = {**vars(setup), **setup.settings}
        if cls.needs_artefact:
            values["artefact"] = setup.certified(cls.kind)
        attributes = {attribute.name for attribute in fields(cls)}
        return cls(poses, **{name: values[name] for name in values if name in attributes})

    from_arrays = FromArrays()

    @classmethod
    def over_arrays(cls, poses: PoseSource, given: Mapping[str, Any]) -> Self:
        """Build the term over poses with the arrays of `columns`, and with attributes by name."""
        term = cls(poses, **given)
        term.check_given()
        return term

    @classmethod
    def read_settings(cls, row: YamlSection) -> dict[str, Any]:
        """The values of the kind's own `keys` and `simulation_keys` in a row or a set, in SI."""
        return Fields(*cls.keys, *cls.simulation_keys).values(row)

    @classmethod
    def columns_in(cls, settings: Mapping[str, Any]) -> SampleColumns:
        """What its samples hold where a row of a job says this, as `read_settings` gives it."""
        del settings
        return cls.columns

    @classmethod
    def marks_in(cls, settings: Mapping[str, Any]) -> Sequence[str]:
        """Marks that a simulation sees at every rest because its settings say so."""
        del settings
        return ()

    @classmethod
    def touches(
        cls,
        rotation: FloatArray,
        position: FloatArray,
        where: FloatArray,
        settings: Mapping[str, Any],
    ) -> FloatArray:
        """Where the tip touches a place, for kinds that touch one without an artefact.

        Args:
            rotation: (3, 3) of the place in the base.
            position: (3,) of the place in the base, m.
            where: (n, 2) numbers from 0 to 1 that say where on it.
            settings: as `read_settings` gives them.

        Returns:
            Positions (n, 3) of the tip in the base, m.
        """
        del rotation, settings
        return np.tile(position, (len(where), 1))

    @classmethod
    def measured(
        cls, place: FloatArray, tips: FloatArray, settings: Mapping[str, Any]
    ) -> dict[str, FloatArray]:
        """Numbers that are measured, with nothing wrong, while the tip touches a place.

        Args:
            place: (3,) or (n, 3) where it is in the base, m.
            tips: (n, 3) in the base, m.
            settings: as `read_settings`, or `settings`, gives them.

        Returns:
            By name of `SampleColumns.numbers`, (n,), in SI; empty where nothing is measured.
        """
        del place, tips, settings
        return {}

    @classmethod
    def refused_rest(cls, mean: FloatArray, std: FloatArray, earlier: FloatArray) -> str:
        """Why what a device sent during a rest is no sample, in a sentence; empty where it is one.

        Args:
            mean: (m,) of the columns `sent`, as the device gives them.
            std: (m,) how one reading scatters.
            earlier: (n, m) means of the rests before.
        """
        del mean, std, earlier
        return ""

    @abstractmethod
    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Closed-form `own_parameters` for tool poses (n, 3, 3), (n, 3): the solver's start.

        Must be finite for any poses, also where the data leave some of them undetermined.
        """

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """What an ideal measurement of these poses would be: the kind's forward model.

        Args:
            values: what is taken for the truth: of the arm and of `own_parameters`, m or rad.
            poses: with the labels that this kind needs; what was seen is not looked at.

        Raises:
            SamplesError: the kind has none.
        """
        del values, poses
        raise SamplesError(
            f"the kind {self.kind}", "one that can be simulated again", where="observations"
        )

    def over_poses(self, poses: PoseSource) -> Self:
        """The same kind of term, with the same noise, artefact and label, over other poses."""
        return replace(self, poses=poses)

    def take(self, rows: ArrayLike) -> Self:
        """The term over some of its samples, by number (repeats allowed) or by boolean mask.

        Raises:
            SamplesError: the kind cannot be built over these rows alone.
        """
        return self.over_poses(self.poses.take(rows))

    def resimulated(
        self, values: Mapping[str, float], noise: Sequence[float], again: Resimulation
    ) -> Self:
        """The term over an arm's samples simulated anew, in nearly the same postures.

        Args:
            values: as of `observed`.
            noise: of each block, m or rad per component of its residual.
            again: how the arm reaches what it touches, and how that scatters.

        Raises:
            SamplesError: the kind has no such simulation, or a target cannot be reached.
        """
        ideal = self.observed(values, self.poses)
        if self.medium != "touch":
            pairs = [*zip(self.blocks, noise, strict=True)]
            by_unit: dict[str, float] = {block.unit: level for block, level in reversed(pairs)}
            units = {number.name: number.scatters_in for number in self.columns.numbers}
            units |= {"position": "m", "rotation": "rad"}
            levels = {name: by_unit[unit] for name, unit in units.items() if unit in by_unit}
            relative = self.blocks[0].relative
            return self.over_poses(again.observed(self.poses, ideal, levels, relative))
        sigma = noise[0] / self.noise_factor
        return self.over_poses(again.touched(self.poses, ideal.place, sigma))

    @property
    def settings(self) -> Mapping[str, Any]:
        """The values of the kind's own `keys` that this term was built with."""
        return {}

    @property
    def with_assumptions_estimated(self) -> Self | None:
        """The same with what it takes for certain estimated; None where it takes nothing so."""
        return None

    @property
    def opens(self) -> Mapping[Gap, tuple[str, str]]:
        """What of `leaves_open` these samples leave open."""
        return self.leaves_open

    @property
    def marked(self) -> bool:
        """Whether the samples say which mark on the tip's link was seen."""
        return self.mark in self.poses.samples.labels

    @property
    def mark_end(self) -> End:
        """Which end of the chain its marks move with."""
        return "tip"

    @property
    def marks_on_body(self) -> bool:
        """Whether its marks are points of one body, which has the label, and no unknowns."""
        return False

    @property
    def touched(self) -> Artefact | None:
        """The artefact whose landmarks are touched, if there is one."""
        return None

    @property
    def board_seen(self) -> Board | None:
        """The board whose corners were seen in pictures, if there is one."""
        return None

    def single_touches(self) -> Term:
        """A term whose first block has one residual for each sample, over the same samples."""
        return self

    def errors_of_touches(self, displacement: FloatArray, samples: IntArray) -> FloatArray:
        """Errors (k, n, d) of rows of the first block that random displacements of touches make.

        Args:
            displacement: (k, samples, 3) independent and alike in every direction, m. A residual
                of d components sees d of them, whichever frame it is written in.
            samples: (n, ·) which samples each row looks at.
        """
        return displacement[:, samples[:, 0], : self.blocks[0].size]

    @property
    def outside(self) -> tuple[ExternalFrame, ...]:
        """The poses and points that the own unknowns are: of `frames`, `places`, and marks."""
        owners: dict[str, set[str]] = {}
        for p in self.own_parameters:
            owners.setdefault(p.owner, set()).add(p.key)
        words = {self.place_unknown: (self.place, "base")} if self.place_unknown else {}
        for frame in self.frames:
            what, _, within = frame.key.partition("_in_")
            words[frame.owner] = (what, within)
        if self.mark:
            words[self.mark] = (self.mark, self.mark_end)
        return tuple(frames_of(owners, words))

    def scanned_points(self, values: Mapping[str, float]) -> FloatArray:
        """(k, 3) points of a surface that was scanned, in the base, m, for a picture."""
        del values
        return np.zeros((0, 3))

    def seen_planes(self, values: Mapping[str, float]) -> Mapping[str, FloatArray]:
        """By name, points (k, 3) of planes that were seen, in what carries them, m."""
        del values
        return {}

    @property
    def sees(self) -> str:
        """The label of what sees, beside those of other chains."""
        end = self.frames[0].end if self.frames else "tip"
        return self.poses.label(getattr(self, "label", "default"), end)

    def _clock(self, offset: TimeOffset) -> Parameter:
        return offset.parameter(self.sees)

    @property
    def of_clock(self) -> tuple[Parameter, ...]:
        """The unknown of the clock of what sees, where it has one."""
        return (self._clock(self.time_offset),) if self.time_offset and self.poses.clock else ()

    def check_given(self) -> None:
        """Refuse given poses that cannot be, and a time offset of samples without times."""
        super().check_given()
        if self.time_offset is not None and self.poses.samples.time is None:
            hint = "without it, remove time_offset_ms"
            raise SamplesError("no time", "when each row was taken, in s", where="time", hint=hint)

    def poses_of(self, block: Block) -> PoseSource:
        """The poses that a block's rows look at, by number of the sample, or each with its lag."""
        if block.lag is None or not isinstance(self.poses, ArmPoses):
            return self.poses
        return self.poses.late(block.samples[:, 0], block.lag, self.of_clock[1].name)

    @property
    def clock_reach(self) -> float:
        """How far from the time of a row it may have been seen, s."""
        return 0.0 if self.time_offset is None else self.time_offset.bound

    @property
    def subject(self) -> str:
        """What the own unknowns are about; terms may share an unknown only if it is the same."""
        return self.kind

    def start_values(self, values: Mapping[str, float]) -> dict[str, float]:
        """`start` by name, at the poses that belong to these parameter values."""
        values_of_clock = {p.name: p.nominal for p in self.of_clock}
        if not self.own_parameters:
            return values_of_clock
        start = self.start(*self.poses.at(values))
        of_term = {p.name: float(v) for p, v in zip(self.own_parameters, start, strict=True)}
        return of_term | values_of_clock

    def repeats(self) -> IntArray:
        """(n,) one number for all samples that are repeats of the same touch, else their own."""
        labels = self.poses.samples.labels
        if not {"placement", "repeat", "landmark"} <= set(labels):
            return np.arange(len(self.poses), dtype=np.intp)
        return same_touches(*(labels[name] for name in ("placement", "landmark", "repeat")))

    @cached_property
    def clusters(self) -> IntArray:
        """(n,) one number, from 0, for all samples that err together.

        They are at one posture, read without moving or met again, repeat a touch, or are of one
        stroke of a sweep (label ``stroke``): they share whatever the model gets wrong there, and
        on which side the tip lies. The sum of their errors counts, not their number.
        """
        strokes = self.poses.samples.labels.get(STROKE)
        same_stroke = [] if strokes is None else [numbered(strokes)[1]]
        return joined(self.poses.postures, self.repeats(), *same_stroke)

    @property
    def notes(self) -> tuple[str, ...]:
        """What must be known of how the samples are used, one sentence each."""
        return ()

    def beside(self, terms: Sequence[Term]) -> Self:
        """The same as the other terms of a job, which it may be among, make it."""
        del terms
        return self

    def check_beside(self, other: Term) -> None:
        """Refuse another term of the job that shares unknowns with this one and says otherwise."""

    def mount(self, rotation: FloatArray, position: FloatArray) -> Mount | None:
        """Where what is seen in place of the tip sits in it, for tips (n, 3, 3), (n, 3).

        None where the tip is not seen, or where the place of what is seen is an own unknown.
        """
        del rotation, position
        return None

    @property
    def on_unknown_mount(self) -> tuple[str, Term] | None:
        """The same with what is seen sitting anywhere on the tip's link; as of `mount`."""
        return None

    @property
    def misread(self) -> Iterator[tuple[str, Term]]:
        """The same with what was observed read in another way; what would have to be so."""
        return iter(())

    @property
    def doubts(self) -> Mapping[str, Level]:
        """What is wrong with the samples by themselves, in sentences: ``care`` or ``bad``."""
        return {}

    def equations(self) -> int:
        """How many independent numbers the samples give at most: a rest counts once."""
        return self._equations

    @cached_property
    def _equations(self) -> int:
        return sum(len(first_of_each(self.readings(b))) * b.size for b in self.blocks)

    def readings(self, block: Block) -> IntArray:
        """(n, k) the same numbers for all rows of a block that read one thing at one rest again."""
        return self.poses.rests[block.samples]

    def check_enough(self) -> None:
        """Refuse sets too small to be fitted; a held-out set may be as small as it likes."""
