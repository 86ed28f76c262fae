"""Where to measure next: which placements, points or poses shrink the uncertainty most."""

from suta_calib.analysis.planning.answer import (
    Best,
    Choice,
    Expected,
    Forecast,
    Plan,
    PlanOptions,
    Remedy,
    Stop,
)
from suta_calib.analysis.planning.candidates import (
    Candidate,
    CandidateFile,
    Place,
    Placement,
    Point,
    Posture,
    read_candidates,
    tilted,
)
from suta_calib.analysis.planning.design import CRITERIA
from suta_calib.analysis.planning.links import link_points
from suta_calib.analysis.planning.plan import candidate_places, plan, situation_of_job
from suta_calib.analysis.planning.region import Pool, Region, directions
from suta_calib.analysis.planning.situation import Situation

__all__ = [
    "CRITERIA",
    "Best",
    "Candidate",
    "CandidateFile",
    "Choice",
    "Expected",
    "Forecast",
    "Place",
    "Placement",
    "Plan",
    "PlanOptions",
    "Point",
    "Pool",
    "Posture",
    "Region",
    "Remedy",
    "Situation",
    "Stop",
    "candidate_places",
    "directions",
    "link_points",
    "plan",
    "read_candidates",
    "situation_of_job",
    "tilted",
]
