"""A process of ours that is killed must not stop others: it shares no memory, whose locks it could hold, with them."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rclpy

PATIENCE_S = 60.0
PROGRAMS = {
    "node": "from joint_id_ros.running import run; run('filter', [])",
    "recorder": "import sys; sys.argv[1:] = ['record', 'bag']; from joint_id_core.cli import main; main()",
}

pytestmark = pytest.mark.skipif(
    rclpy.get_rmw_implementation_identifier() != "rmw_fastrtps_cpp", reason="another middleware than Fast DDS"
)


def threads(program, folder, **chosen):
    """Return the names of the threads of Fast DDS in a process, once it listens."""
    environment = {n: v for n, v in os.environ.items() if n != "FASTDDS_BUILTIN_TRANSPORTS"} | chosen
    environment |= {"ROS_DOMAIN_ID": str(101 + os.getpid() % 100), "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    process = subprocess.Popen([sys.executable, "-c", PROGRAMS[program]], cwd=folder, env=environment)
    try:
        end = time.monotonic() + PATIENCE_S
        while True:
            assert time.monotonic() < end and process.poll() is None
            names = {path.read_text().strip() for path in Path(f"/proc/{process.pid}/task").glob("*/comm")}
            if sum(name.startswith("dds.udp") for name in names) > 2:  # all that listen are there
                return names
            time.sleep(0.05)
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("program", ["node", pytest.param("recorder", marks=pytest.mark.long)])
def test_no_memory_is_shared_unless_the_user_says_so(program, tmp_path):
    assert not any(name.startswith("dds.shm") for name in threads(program, tmp_path))
    chosen = threads(program, tmp_path, FASTDDS_BUILTIN_TRANSPORTS="DEFAULT")
    assert any(name.startswith("dds.shm") for name in chosen)
