from .calibrated import Calibrated as Calibrated
from .calibration import calibration_page as calibration_page
from .calibration import calibration_scene as calibration_scene
from .calibration import show as show
from .drawn_arm import DrawnArm as DrawnArm
from .scene import ArmScene as ArmScene
from .server import Viewer as Viewer
