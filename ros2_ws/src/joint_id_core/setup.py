from setuptools import find_packages, setup

setup(
    name="joint_id_core",
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={"joint_id_core": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/joint_id_core"]),
        ("share/joint_id_core", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy>=1.26", "scipy>=1.11", "sympy>=1.12", "numba>=0.58", "pyyaml", "rosbags>=0.10", "typer>=0.9"],
    extras_require={"hpinn": ["torch>=2.1"], "plot": ["matplotlib>=3.6"]},
    zip_safe=True,
    maintainer="joint_id maintainers",
    maintainer_email="maintainers@users.noreply.github.com",
    description="Identification of the dynamics of collaborative robot joints, without ROS.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["joint-id = joint_id_core.cli:main"]},
)
