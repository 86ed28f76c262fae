"""A robot with two arms, a hand whose fingers follow one another, and nothing behind it."""

from __future__ import annotations

# Two arms on a column that turns, each with a flange; a gripper whose second finger follows the
# first, and a third that follows the second.
ROBOT = """<robot name="two_arms">
  <link name="floor"/><link name="column"/><link name="l1"/><link name="l2"/><link name="left"/>
  <link name="r1"/><link name="right"/><link name="f1"/><link name="f2"/><link name="f3"/>
  <joint name="turn" type="continuous"><parent link="floor"/><child link="column"/></joint>
  <joint name="left_1" type="continuous"><parent link="column"/><child link="l1"/>
    <origin xyz="0 0.2 1"/><axis xyz="0 0 1"/></joint>
  <joint name="left_2" type="revolute"><parent link="l1"/><child link="l2"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="left_flange" type="fixed"><parent link="l2"/><child link="left"/>
    <origin xyz="0.3 0 0"/></joint>
  <joint name="right_1" type="revolute"><parent link="column"/><child link="r1"/>
    <origin xyz="0 -0.2 1"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="right_flange" type="fixed"><parent link="r1"/><child link="right"/>
    <origin xyz="0.3 0 0"/></joint>
  <joint name="finger_1" type="prismatic"><parent link="right"/><child link="f1"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="finger_2" type="revolute"><parent link="right"/><child link="f2"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
    <mimic joint="finger_1" multiplier="-4" offset="0.1"/></joint>
  <joint name="finger_3" type="revolute"><parent link="f2"/><child link="f3"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
    <mimic joint="finger_2" multiplier="0.5"/></joint>
</robot>
"""
