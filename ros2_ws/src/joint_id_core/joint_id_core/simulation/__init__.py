"""Forward simulation with exact stick and slip: joints, sensors, position control and motions."""

from joint_id_core.simulation.motion import simulate_motion as simulate_motion
from joint_id_core.simulation.simulator import simulate as simulate
