"""The only list of nodes and their ROS parameters; documentation, launch files and tests use it."""

from __future__ import annotations

from joint_id_core.alignment.inputs import InputOptions
from joint_id_core.filtering.offline import FilterOptions
from joint_id_core.online.options import OnlineOptions
from joint_id_core.rtde.stream import StreamOptions
from joint_id_core.simulation.plants import MotionOptions
from joint_id_ros.options.arm_identifier import ArmIdentifierOptions
from joint_id_ros.options.baselines import BaselineOptions
from joint_id_ros.options.driver import DriverOptions
from joint_id_ros.options.emulated_motion import EmulatedMotionOptions
from joint_id_ros.options.fleet import FleetOptions
from joint_id_ros.options.identifier import IdentifierOptions
from joint_id_ros.options.identify import IdentifyOptions
from joint_id_ros.options.load import LoadOptions
from joint_id_ros.options.player import PlayerOptions
from joint_id_ros.options.reading import BagReadingOptions, FilterReadingOptions, ReadingOptions
from joint_id_ros.options.sim import SimOptions
from joint_id_ros.options.watch import WatchFleetOptions, WatchOptions

NODES: dict[str, tuple[type, ...]] = {
    "sim": (SimOptions, MotionOptions),
    "filter": (InputOptions, FilterOptions, LoadOptions, FilterReadingOptions),
    "identifier": (IdentifierOptions, OnlineOptions, BaselineOptions, LoadOptions, BagReadingOptions),
    "arm_identifier": (ArmIdentifierOptions, ReadingOptions),
    "player": (PlayerOptions,),
    "driver": (DriverOptions, StreamOptions),
    "watch": (WatchOptions,),
    "identify": (IdentifyOptions,),
    "emulated_motion": (EmulatedMotionOptions,),
    "fleet": (FleetOptions,),
    "watch_fleet": (WatchFleetOptions,),
}
