"""The tracked tip in ROS 2: `suta-calib track … --udp 127.0.0.1:5005` as tf and a pose."""

import json
import math
import socket

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from rclpy.node import Node
from tf2_ros import TransformBroadcaster


class PoseNode(Node):
    def __init__(self):
        super().__init__("suta_pose")
        port = self.declare_parameter("port", 5005).value
        self.base = self.declare_parameter("base", "base_link").value
        self.tip = self.declare_parameter("tip", "tip").value
        self.poses = self.create_publisher(PoseWithCovarianceStamped, "tip_pose", 10)
        self.broadcaster = TransformBroadcaster(self)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("0.0.0.0", port))
        self.socket.setblocking(False)
        self.create_timer(0.005, self.receive)

    def receive(self):
        try:
            while True:
                told = json.loads(self.socket.recv(65535))
                if told["valid"]:
                    self.publish(told)
        except BlockingIOError:
            pass

    def publish(self, told):
        transform, pose = TransformStamped(), PoseWithCovarianceStamped()
        transform.header.stamp = pose.header.stamp = self.get_clock().now().to_msg()
        transform.header.frame_id = pose.header.frame_id = self.base
        transform.child_frame_id = self.tip
        at, turn = transform.transform.translation, transform.transform.rotation
        at.x, at.y, at.z = told["position"]
        turn.x, turn.y, turn.z, turn.w = told["quaternion"]
        place = pose.pose.pose
        place.position.x, place.position.y, place.position.z = told["position"]
        place.orientation = turn
        # Nothing is sent of how sure the orientation is, nor the position without a result.json.
        std = (told["std"] or [10.0] * 3) + [math.pi] * 3
        pose.pose.covariance = [std[k // 7] ** 2 if k % 7 == 0 else 0.0 for k in range(36)]
        self.broadcaster.sendTransform(transform)
        self.poses.publish(pose)


def main():
    rclpy.init()
    rclpy.spin(PoseNode())


if __name__ == "__main__":
    main()
