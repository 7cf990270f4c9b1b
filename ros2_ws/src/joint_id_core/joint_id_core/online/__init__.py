"""Online identification: a first window is fitted, then every sample counts once while the robot moves."""

from joint_id_core.online.drift import Drift as Drift
from joint_id_core.online.drift import DriftMonitor as DriftMonitor
from joint_id_core.online.drift import DriftOptions as DriftOptions
from joint_id_core.online.identifier import OnlineIdentifier as OnlineIdentifier
from joint_id_core.online.options import OnlineOptions as OnlineOptions
