"""Node ``live``: subscriptions, publishers and timers around :class:`schuler.live.ros.RosRun`, which does the work."""

from __future__ import annotations

from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, NavSatFix
from tf2_ros import TransformBroadcaster

from schuler.live.ros import RosRun, fill

_QUEUE = 10
_DIAGNOSTICS_S = 1.0


class LiveNode(Node):
    """Live navigation of ``imu/data``, ``gnss/fix`` and ``wheel/odometry``; remap them as usual."""

    def __init__(self) -> None:
        super().__init__("live", automatically_declare_parameters_from_overrides=True)
        given = self.get_parameters_by_prefix("")
        self.run = RosRun({name: parameter.value for name, parameter in given.items()})
        self._publishers_of = {
            "odometry": (Odometry, self.create_publisher(Odometry, "~/odometry", _QUEUE).publish),
            "fix": (NavSatFix, self.create_publisher(NavSatFix, "~/fix", _QUEUE).publish),
            "transform": (TransformStamped, TransformBroadcaster(self).sendTransform),
        }
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", _QUEUE)
        self.create_subscription(Imu, "imu/data", self._imu, qos_profile_sensor_data)
        self.create_subscription(NavSatFix, "gnss/fix", self.run.fix, qos_profile_sensor_data)
        self.create_subscription(Odometry, "wheel/odometry", self.run.odometry, qos_profile_sensor_data)
        self.create_timer(_DIAGNOSTICS_S, self._diagnose)
        self.create_timer(float(self.run.options["state_every_s"]), self.run.save)

    def _imu(self, message: Any) -> None:
        for sending in self.run.imu(message):
            kind, send = self._publishers_of[sending.name]
            send(fill(kind(), sending))
        for event in self.run.events():
            self.get_logger().info(event.text)

    def _diagnose(self) -> None:
        level, text, values = self.run.diagnostics()
        status = DiagnosticStatus()
        status.level, status.name, status.message = bytes([level]), "schuler live", text
        for key, value in values.items():
            entry = KeyValue()
            entry.key, entry.value = key, value
            status.values.append(entry)
        array = DiagnosticArray()
        array.header.stamp = self.get_clock().now().to_msg()
        array.status.append(status)
        self._diagnostics.publish(array)


def main() -> None:
    """Run the node until it is stopped, and save its state."""
    rclpy.init()
    node = LiveNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.run.save()
        node.destroy_node()
        rclpy.try_shutdown()
