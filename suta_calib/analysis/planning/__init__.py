"""Where to measure next: which placements, points or poses shrink the uncertainty most."""

from suta_calib.analysis.planning.answer import Best, Choice, Plan, PlanOptions, Stop
from suta_calib.analysis.planning.candidates import Candidate, Place, Placement, Point, Posture
from suta_calib.analysis.planning.candidates_file import CandidateFile, read_candidates
from suta_calib.analysis.planning.design import CRITERIA
from suta_calib.analysis.planning.generate import Pool
from suta_calib.analysis.planning.plan import plan
from suta_calib.analysis.planning.region import Region
from suta_calib.analysis.planning.situation import Situation

__all__ = [
    "CRITERIA",
    "Best",
    "Candidate",
    "CandidateFile",
    "Choice",
    "Place",
    "Placement",
    "Plan",
    "PlanOptions",
    "Point",
    "Pool",
    "Posture",
    "Region",
    "Situation",
    "Stop",
    "plan",
    "read_candidates",
]
