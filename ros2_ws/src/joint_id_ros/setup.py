from glob import glob

from setuptools import find_packages, setup

setup(
    name="joint_id_ros",
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={"joint_id_ros": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/joint_id_ros"]),
        ("share/joint_id_ros", ["package.xml"]),
        ("share/joint_id_ros/launch", sorted(glob("launch/*.launch.py"))),
        ("share/joint_id_ros/config", sorted(glob("config/*"))),
    ],
    install_requires=["setuptools", "numpy>=1.26", "joint_id_core"],
    zip_safe=True,
    author="joint_id maintainers",
    maintainer="joint_id maintainers",
    maintainer_email="maintainers@users.noreply.github.com",
    description="ROS 2 nodes of joint_id: simulate, filter, identify and replay robot joints.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "sim = joint_id_ros.running:sim",
            "filter = joint_id_ros.running:filter",
            "identifier = joint_id_ros.running:identifier",
            "player = joint_id_ros.running:player",
            "arm_identifier = joint_id_ros.running:arm_identifier",
            "driver = joint_id_ros.running:driver",
            "watch = joint_id_ros.running:watch",
            "identify = joint_id_ros.running:identify",
            "emulated_motion = joint_id_ros.running:emulated_motion",
            "fleet = joint_id_ros.running:fleet",
            "watch_fleet = joint_id_ros.running:watch_fleet",
        ],
        "joint_id.commands": [
            "record = joint_id_ros.record:record",
            "watch = joint_id_ros.watch:watch",
            "fleet = joint_id_ros.fleet_command:fleet",
        ],
        "joint_id.checks": ["ros = joint_id_ros.doctor:checks"],
    },
)
