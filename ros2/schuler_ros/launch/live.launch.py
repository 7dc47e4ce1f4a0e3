"""The node with a file of parameters: ``ros2 launch schuler_ros live.launch.py params:=live.yaml``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Description of the launch, by the name that launch calls."""
    default = PathJoinSubstitution([FindPackageShare("schuler_ros"), "config", "live.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", default_value=default),
            Node(
                package="schuler_ros",
                executable="live",
                name="live",
                parameters=[LaunchConfiguration("params")],
                output="screen",
            ),
        ]
    )
