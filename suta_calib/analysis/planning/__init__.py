"""Where to measure next: which placements, points or poses shrink the uncertainty most."""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.analysis.planning.answer import Best as Best
    from suta_calib.analysis.planning.answer import Choice as Choice
    from suta_calib.analysis.planning.answer import Expected as Expected
    from suta_calib.analysis.planning.answer import Forecast as Forecast
    from suta_calib.analysis.planning.answer import Plan as Plan
    from suta_calib.analysis.planning.answer import PlanOptions as PlanOptions
    from suta_calib.analysis.planning.answer import Remedy as Remedy
    from suta_calib.analysis.planning.answer import Stop as Stop
    from suta_calib.analysis.planning.candidates import Candidate as Candidate
    from suta_calib.analysis.planning.candidates import CandidateFile as CandidateFile
    from suta_calib.analysis.planning.candidates import Place as Place
    from suta_calib.analysis.planning.candidates import Placement as Placement
    from suta_calib.analysis.planning.candidates import Point as Point
    from suta_calib.analysis.planning.candidates import Posture as Posture
    from suta_calib.analysis.planning.candidates import read_candidates as read_candidates
    from suta_calib.analysis.planning.candidates import tilted as tilted
    from suta_calib.analysis.planning.design import CRITERIA as CRITERIA
    from suta_calib.analysis.planning.design import Design as Design
    from suta_calib.analysis.planning.design import SharedInformation as SharedInformation
    from suta_calib.analysis.planning.design import Space as Space
    from suta_calib.analysis.planning.design import best_set as best_set
    from suta_calib.analysis.planning.design import candidate_information as candidate_information
    from suta_calib.analysis.planning.design import no_information as no_information
    from suta_calib.analysis.planning.design import random_sets as random_sets
    from suta_calib.analysis.planning.planner import candidate_places as candidate_places
    from suta_calib.analysis.planning.planner import forecast as forecast
    from suta_calib.analysis.planning.planner import plan as plan
    from suta_calib.analysis.planning.planner import situation_of_job as situation_of_job
    from suta_calib.analysis.planning.planner import tip_weight as tip_weight
    from suta_calib.analysis.planning.plots import draw_bench as draw_bench
    from suta_calib.analysis.planning.plots import draw_gain as draw_gain
    from suta_calib.analysis.planning.reach import Reach as Reach
    from suta_calib.analysis.planning.reach import link_points as link_points
    from suta_calib.analysis.planning.region import Pool as Pool
    from suta_calib.analysis.planning.region import Region as Region
    from suta_calib.analysis.planning.region import candidate_pool as candidate_pool
    from suta_calib.analysis.planning.region import directions as directions
    from suta_calib.analysis.planning.situation import Situation as Situation

__getattr__, __all__ = public(__name__)
