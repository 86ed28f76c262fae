from .points import CertificationOptions as CertificationOptions
from .points import RawPoints as RawPoints
from .points import read_raw_points as read_raw_points
from .procedure import certify as certify
from .result import Certification as Certification
from .result import CertifiedLandmark as CertifiedLandmark
from .result import write_certified as write_certified
