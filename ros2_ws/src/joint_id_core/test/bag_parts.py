"""Recordings, messages and files that the tests of bags share."""

import numpy as np

from joint_id_core.data.recording import Recording

STORAGES = ("mcap", "sqlite3")
JOINT_STATE = "sensor_msgs/msg/JointState"
RAW = ("link_position", "link_velocity", "current", "motor_position", "motor_velocity", "voltage", "torque")


def recording(channels=RAW, n=20, seed=0, start=0.0):
    rng = np.random.default_rng(seed)
    time = start + (np.cumsum(rng.integers(1, 9, n)) * 1_234_567) / 1e9
    values = {name: rng.normal(size=n) for name in channels}
    for column in values.values():
        column[3] = np.nan
    return Recording(time, values)


def joint_state(store, stamp, names, position=(), velocity=(), effort=()):
    types = store.types
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    arrays = [np.array(values, dtype=float) for values in (position, velocity, effort)]
    return types[JOINT_STATE](types["std_msgs/msg/Header"](time, ""), list(names), *arrays)


def data_file(path):
    return next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3"))
