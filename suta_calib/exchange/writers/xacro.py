"""A xacro file that one includes: a macro with the calibrated origin of each joint."""

from __future__ import annotations

from xml.sax.saxutils import escape, quoteattr

from suta_calib.errors import InputError
from suta_calib.exchange.option import Given
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.model.urdf import number_text

_HEAD = """\
<?xml version="1.0" encoding="utf-8"?>
<!-- Calibrated origins. Include this file, and put
       <xacro:calibrated_origin joint="NAME"/>
     in place of the <origin> of each of these joints. -->
<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="calibrated_origin" params="joint">
"""


class XacroWriter(Writer):
    """The macro ``calibrated_origin``, which stands for a joint's ``<origin>``."""

    name = "xacro"
    summary = "a macro calibrated_origin, to include in your .xacro"
    example = "results --format xacro --out calibrated_origins.xacro"
    file = "exported_origins.xacro"

    def content(self, result: Result, _given: Given) -> bytes:
        """One condition for each joint, numbers to 1e-12."""
        arm = result.need_arm(self.name)
        parts = [_HEAD]
        for name, (xyz, rpy) in arm.model.origins(arm.values).items():
            if not set(name).isdisjoint("'\"\\$"):
                raise InputError(f"a joint {name!r}", "names without quotes, \\ and $ in a xacro")
            numbers = [" ".join(map(number_text, three)) for three in (xyz, rpy)]
            condition = quoteattr("${joint == '" + name + "'}")
            parts.append(
                f"    <xacro:if value={condition}>\n"
                f'      <origin xyz="{escape(numbers[0])}" rpy="{escape(numbers[1])}"/>\n'
                "    </xacro:if>\n"
            )
        return "".join([*parts, "  </xacro:macro>\n</robot>\n"]).encode()
