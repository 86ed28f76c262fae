from .calibrating import calibrate_jobs as calibrate_jobs
from .jobs import FleetJob as FleetJob
from .jobs import common_folder as common_folder
from .jobs import fleet_jobs as fleet_jobs
from .summary import FleetSummary as FleetSummary
from .summary import JobResult as JobResult
from .summary import fleet_document as fleet_document
