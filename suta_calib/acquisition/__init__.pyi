from .averaging import Average as Average
from .averaging import average as average
from .measuring import Measured as Measured
from .measuring import MeasureOptions as MeasureOptions
from .measuring import measure as measure
from .rest import RestDetector as RestDetector
from .rest import RestSettings as RestSettings
from .stops import StopFinder as StopFinder
