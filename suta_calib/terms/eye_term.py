"""Common parts of kinds in which an eye, on the hand or beside the arm, sees something."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Final

from suta_calib.errors import SamplesError
from suta_calib.measurements import Board
from suta_calib.measurements.fields import TEXT, Field, choice
from suta_calib.measurements.scale import LengthScale
from suta_calib.model.parameters import PLACEMENT, End
from suta_calib.terms.external_frame import ExternalFrame, labelled
from suta_calib.terms.eye import carriers
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND, EyeSetup
from suta_calib.terms.instrument_terms import FramedTerm
from suta_calib.terms.observed import TrueFrame
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Gap, Term

EYE: Final = TrueFrame(
    *("hand_eye", "camera_pose"),
    "the camera's pose: on the tip, or in the base for eye-to-hand",
    required=True,
)
BOARD: Final = TrueFrame(
    *("target", "board_pose"),
    "the board's pose: in the base, or on the tip for eye-to-hand",
    required=True,
)
TARGET_KEY: Final = Field("target", TEXT, "Label of the board, where there are several.")


def setup_key(seen: str) -> Field:
    """The key ``setup`` of an eye that sees something of this name."""
    about = f"eye-in-hand (the default), or eye-to-hand: the {seen} on the tip."
    return Field("setup", choice((EYE_IN_HAND, EYE_TO_HAND)), about)


@dataclass(frozen=True, eq=False, repr=False)
class EyeTerm(FramedTerm):
    """What an eye sees whose pose X is unknown: ``T_hand_eye``, or ``T_base_eye`` beside the arm.

    Attributes:
        setup: the eye is on the hand, or beside the arm.
        label: terms with the same label share the eye.
    """

    medium = "camera"
    # What a camera sees is as large as the target was printed.
    assumed_scale = LengthScale.of_grade("printed")
    has_angles = False
    frames: ClassVar[tuple[TrueFrame, ...]] = (EYE,)
    chance = 0.02
    leaves_open: ClassVar[Mapping[Gap, tuple[str, str]]] = {
        "tool": (
            "moves the tip in the last link. The camera does not see this, because the unknown "
            "pose of the camera, or of what it sees, on the tip cancels it",
            "touch one fixed point from several directions (fixed_point); not needed if only the "
            "camera matters",
        )
    }

    setup: EyeSetup = field(default=EYE_IN_HAND, kw_only=True)
    label: str = field(default="default", kw_only=True)

    @property
    def ends(self) -> tuple[End, End]:
        """Of what carries the eye, and of what carries what it sees."""
        return carriers(self.setup)

    @property
    def subject(self) -> str:
        """One eye may see things of several kinds."""
        return self.medium

    @property
    def sees(self) -> str:
        """The label of the eye, beside those of other chains."""
        return self.poses.label(self.label, self.ends[0])

    @property
    def frame_names(self) -> list[str]:
        """The owner of the eye's pose."""
        return [labelled(EYE.owner, self.sees)]

    @property
    def eye_outside(self) -> ExternalFrame:
        """The eye, in what carries it."""
        return ExternalFrame(self.frame_names[0], self.medium, self.ends[0], PLACEMENT)

    @property
    def stated(self) -> Mapping[tuple[str, str, str], object]:
        """What it says of what rows share, by key of the job, kind of label and label."""
        return {("setup", "label", self.sees): self.setup}

    def check_beside(self, other: Term) -> None:
        """Rows with one label are of one camera, and those with one target of one board."""
        if not isinstance(other, EyeTerm):
            return
        stated = self.stated
        for (key, whose, name), statement in other.stated.items():
            if stated.get((key, whose, name), statement) != statement:
                raise SamplesError(
                    f"another {key} than in an earlier row with the same {whose} {name!r}",
                    "one camera and one board per label",
                    where=f"{self.kind}.{key}",
                    hint=f"write the same in both rows, or give the second one another {whose}",
                )


@dataclass(frozen=True, eq=False, repr=False)
class BoardEyeTerm(EyeTerm):
    """An eye that sees a board whose pose Z is unknown too, in what does not carry the eye.

    Attributes:
        board: whose points are seen, if they are of one.
        target: terms with the same one share the board.
    """

    frames = (EYE, BOARD)

    board: Board | None = None
    target: str = field(default="default", kw_only=True)

    @property
    def sees_board(self) -> str:
        """The label of the board, beside those of other chains."""
        return self.poses.label(self.target, self.ends[1])

    @property
    def frame_names(self) -> list[str]:
        """Owners of the poses of the eye and of the board."""
        return [*super().frame_names, labelled(BOARD.owner, self.sees_board)]

    @property
    def board_outside(self) -> ExternalFrame:
        """The board, in what carries it."""
        return ExternalFrame(self.frame_names[1], "board", self.ends[1], PLACEMENT)

    @property
    def stretch(self) -> float | None:
        """The prior of the board's stretch; of poses that were measured it is not estimated."""
        return self.board.stretch if self.board and isinstance(self.poses, ArmPoses) else None

    @property
    def stated(self) -> Mapping[tuple[str, str, str], object]:
        """With the board."""
        if self.board is None:
            return super().stated
        return {**super().stated, ("board", "target", self.sees_board): self.board.row()}
