"""Is the calibration still right, in ROS 2: rows come by themselves, and a diagnostic says it.

Each time the arm has stood still, the joints and what the instrument or the camera saw are a row of
`suta-calib check --follow`; after a change the diagnostic is an error that names it.
"""

import sys

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib import Samples
from suta_calib.check import Follow, read_back

STILL = 1e-3  # rad or m within which an arm stands still from message to message


class RowChecker:
    """Rows against a result: this part needs no ROS."""

    def __init__(self, result):
        self.written = read_back(result)
        self.term = self.written.job.observations[0]
        self.follow = Follow(self.written.checker)
        self.joints, self.last, self.taken = self.term.poses.arm.joints, None, None

    def stands(self, names, positions):
        """Readings of an arm that stands still where no row was taken yet; else None."""
        q = np.array([dict(zip(names, positions, strict=True))[joint] for joint in self.joints])
        last, self.last = self.last, q
        here = self.taken is not None and np.abs(q - self.taken).max() < 20 * STILL
        return None if here or last is None or np.abs(q - last).max() > STILL else q

    def take(self, q, position, quaternion):
        """One row; returns a level (0: fine, 2: changed) and a sentence."""
        self.taken = q
        turned = self.term.poses.samples.rotation is not None
        rotation = Rotation.from_quat(quaternion).as_matrix()[None] if turned else None
        row = Samples.from_arrays(self.joints, q[None], position=[position], rotation=rotation)
        step = self.follow.add(self.term.over_poses(self.term.poses.with_samples(row)))
        if step.changed:
            return 2, " ".join(change.sentence for change in self.follow.check().changed)
        return 0, f"{step.rows} rows, evidence {step.evidence:.2g} of {step.limit:g}"


def main():
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
    from geometry_msgs.msg import PoseStamped
    from sensor_msgs.msg import JointState

    rclpy.init()
    node, rows, seen = rclpy.create_node("suta_check"), RowChecker(sys.argv[1]), {}
    said = node.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def moved(message):
        q = rows.stands(message.name, message.position)
        if q is not None and "pose" in seen:
            pose = seen.pop("pose")
            p, r = pose.position, pose.orientation
            status(rows.take(q, [p.x, p.y, p.z], [r.x, r.y, r.z, r.w]))

    def status(found):
        level, sentence = found
        entry = DiagnosticStatus(level=bytes([level]), name="calibration", message=sentence)
        said.publish(DiagnosticArray(status=[entry]))

    node.create_subscription(PoseStamped, "seen_pose", lambda m: seen.update(pose=m.pose), 10)
    node.create_subscription(JointState, "joint_states", moved, 10)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
