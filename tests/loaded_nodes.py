"""What nodes load before they are at work; the process that they are forked from imports this."""

from __future__ import annotations

import gc
from importlib import import_module

from joint_id_core.estimators import Innovations, ParameterSettings
from joint_id_core.models import build
from joint_id_ros.options.node_list import NODES

for _name in NODES:
    import_module(f"joint_id_ros.nodes.{_name}")
for _name in ("rclpy.executors", "node_process"):  # the second has what a fork runs
    import_module(_name)
Innovations().compile(build("rigid_joint"), ParameterSettings())  # the model of most of these tests
# Nodes collect what is garbage as they start: what stands here would be looked through, and so copied, by each.
gc.collect()
gc.freeze()
