from setuptools import find_packages, setup

setup(
    name="joint_id_core",
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={"joint_id_core": ["py.typed", "pages/assets/*", "robots/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/joint_id_core"]),
        ("share/joint_id_core", ["package.xml"]),
    ],
    python_requires=">=3.11",
    install_requires=[
        "setuptools",
        "numpy>=1.26",
        "scipy>=1.11",
        "sympy>=1.12",
        "mcap>=1.5",
        "numba>=0.58",
        "pyyaml>=6",
        "rosbags>=0.10",
        "typer>=0.9",
    ],
    extras_require={
        "arm": ["pin>=2.7"],
        "batch": ["pyarrow>=16", "fsspec>=2024.2"],
        "dask": ["distributed>=2024.2"],
        "hpinn": ["torch>=2.1"],
        "plot": ["matplotlib>=3.6"],
        "s3": ["s3fs>=2024.2"],
        "test": ["pytest", "hypothesis"],
    },
    zip_safe=True,
    author="joint_id maintainers",
    maintainer="joint_id maintainers",
    maintainer_email="maintainers@users.noreply.github.com",
    description="Identification of the dynamics of collaborative robot joints, without ROS.",
    license="Apache-2.0",
    # A package with a command of its own for joint-id adds it to the group joint_id.commands (joint_id_ros: record).
    entry_points={
        "console_scripts": ["joint-id = joint_id_core.command:main"],
    },
)
