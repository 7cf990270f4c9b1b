"""Fit a joint of a ROS 2 bag (mcap or sqlite3), without ROS.

A bag that `joint-id record` or the nodes wrote needs no mapping. For other topics give one, e.g.
`jid.read(bag, "elbow_joint", {"current": "joint_states.effort", "link_position": "joint_states.position"})`.
"""

from pathlib import Path

import joint_id_core as jid
from joint_id_core import formats

bag = Path(__file__).parents[1] / "bags/model_2_multisine"
print("topics:", "; ".join(formats.contents(bag)))
print("joints:", ", ".join(formats.joints(bag)))

joint = formats.joints(bag)[0]
recording = jid.read(bag, joint)
print(f"{joint}: {len(recording)} samples, {recording.duration:.3g} s, {1 / recording.period:.0f} Hz")

# The bag holds the motor current, so the torque constant k_t must be given. Three seconds are enough.
model = jid.build("harmonic_drive", actuation="current")
first = recording.time[0]
estimate = jid.fit(model, recording.window(first, first + 3.0), jid.ParameterSettings({"k_t": 0.05507}))
print(repr(estimate))
