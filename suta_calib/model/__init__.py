"""The arm whose geometry is unknown: a chain of a URDF, its parameters, its kinematics.

Names are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.model.arm import ArmModel as ArmModel
    from suta_calib.model.chain import Chain as Chain
    from suta_calib.model.chain import ChainJoint as ChainJoint
    from suta_calib.model.chain import read_chain as read_chain
    from suta_calib.model.dh import DhRow as DhRow
    from suta_calib.model.dh import DhTable as DhTable
    from suta_calib.model.dh import dh_table as dh_table
    from suta_calib.model.parameters import Parameter as Parameter
    from suta_calib.model.parameters import ParameterSet as ParameterSet
    from suta_calib.model.parameters import Selection as Selection
    from suta_calib.model.urdf import write_urdf as write_urdf

__getattr__, __all__ = public(__name__)
