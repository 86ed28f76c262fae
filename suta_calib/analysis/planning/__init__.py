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
from suta_calib.analysis.planning.design import (
    CRITERIA,
    Design,
    SharedInformation,
    Space,
    best_set,
    nothing,
    promised,
    random_sets,
)
from suta_calib.analysis.planning.links import link_points
from suta_calib.analysis.planning.plan import (
    candidate_places,
    forecast,
    plan,
    situation_of_job,
    tip_weight,
)
from suta_calib.analysis.planning.reach import Reach
from suta_calib.analysis.planning.region import Pool, Region, directions, generated
from suta_calib.analysis.planning.situation import Situation

__all__ = [
    "CRITERIA",
    "Best",
    "Candidate",
    "CandidateFile",
    "Choice",
    "Design",
    "Expected",
    "Forecast",
    "Place",
    "Placement",
    "Plan",
    "PlanOptions",
    "Point",
    "Pool",
    "Posture",
    "Reach",
    "Region",
    "Remedy",
    "SharedInformation",
    "Situation",
    "Space",
    "Stop",
    "best_set",
    "candidate_places",
    "directions",
    "forecast",
    "generated",
    "link_points",
    "nothing",
    "plan",
    "promised",
    "random_sets",
    "read_candidates",
    "situation_of_job",
    "tilted",
    "tip_weight",
]
