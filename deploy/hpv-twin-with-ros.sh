#!/bin/bash
# /opt/hpv-twin/bin/hpv-twin where ROS comes from its distribution: sources it, then runs the command.
source /opt/ros/jazzy/setup.bash
source /opt/hpv-twin/install/setup.bash
exec /opt/hpv-twin/install/hpv_twin/bin/hpv-twin "$@"
