#!/bin/sh
# Build the workspace with colcon from the virtual environment; write the environment file and the launchers.
# Usage: setup/build.sh VENV. Variables of other ROS installations are unset, so that they do not interfere.
set -eu

root=$(cd "$(dirname "$0")/.." && pwd)
venv=$(cd "$1" && pwd)
workspace=$root/ros2_ws
log=$workspace/log/setup.log
mkdir -p "$workspace/log"

unset PYTHONPATH PYTHONHOME CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH ROS_DISTRO _ROS_WHEELS_BOOTSTRAP_COMPLETE || true
export VIRTUAL_ENV="$venv" AMENT_PREFIX_PATH="$venv" PATH="$venv/bin:$PATH" COLCON_HOME="$venv/colcon"

cd "$workspace"
echo "building ros2_ws with colcon (output in ros2_ws/log/setup.log)"
if ! colcon --log-base log build --symlink-install --event-handlers console_cohesion+ \
    --cmake-args -GNinja -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF "-DPython3_EXECUTABLE=$venv/bin/python" \
    "-DCMAKE_PROJECT_INCLUDE=$root/setup/drop_missing_includes.cmake" >"$log" 2>&1; then
    tail -n 60 "$log" >&2
    echo "make setup: the build of ros2_ws failed: its last lines are above, the whole output is in $log" >&2
    exit 1
fi
bash -c '. install/setup.bash && exec python "$@"' bash "$root/setup/launchers.py" "$venv" "$workspace/install"
