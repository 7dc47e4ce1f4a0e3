"""Package of the ROS 2 node, as ament_python builds it."""

from setuptools import setup

NAME = "schuler_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/live.launch.py"]),
        (f"share/{NAME}/config", ["config/live.yaml"]),
    ],
    install_requires=["setuptools", "schuler"],
    zip_safe=True,
    maintainer="The schuler developers",
    maintainer_email="schuler@example.org",
    description="Live inertial navigation of sensor_msgs/Imu and NavSatFix with the filter of schuler",
    license="BSD-3-Clause",
    entry_points={"console_scripts": [f"live = {NAME}.node:main"]},
)
