from .checking import FALSE_ALARM as FALSE_ALARM
from .checking import Check as Check
from .checking import Checker as Checker
from .checking import FoundChange as FoundChange
from .checking import FoundPower as FoundPower
from .repair import Repair as Repair
from .repair import can_repair as can_repair
from .repair import repaired as repaired
