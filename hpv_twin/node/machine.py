"""`hpv-twin machine`: a stand-in for a real machine, as a node or as a file of its sensors."""
from __future__ import annotations

import sys

from .process import run_node

USAGE = """\
usage: hpv-twin machine [--ros-args -p NAME:=VALUE … -r FROM:=TO …]
       hpv-twin machine --to-file OUT.mcap [options]     without ROS; --to-file --help tells

A machine to measure when there is none: it publishes what a pressure sensor and a displacement
sensor would show, with noise, and with faults that can be switched while it runs.

examples:
  hpv-twin machine
  hpv-twin machine --ros-args -p vibrator:=other.yaml -p pressure_noise:=2e5
  hpv-twin machine --ros-args -p air_in_oil:=0.4
  ros2 param set /machine worn_slot 0.5
  hpv-twin machine --ros-args -r '~/pump_flow_setpoint:=/hpv_twin/pump_flow'    it obeys a twin
  hpv-twin machine --to-file OUT.mcap --duration 60 --rate 5000 --fault air_in_oil=0.4@20

publishes:
  ~/pressure              sensor_msgs/msg/FluidPressure, absolute, Pa
  ~/plunger_position      sensor_msgs/msg/JointState, joint plunger, position m
listens to (std_msgs/msg/Float64):
"""


def main(argv: list[str] | None = None) -> int:
    """Run the machine until a signal, or write its file; 2 for bad parameters."""
    argv = sys.argv[1:] if argv is None else argv
    if any(word.split('=')[0] == '--to-file' for word in argv):
        from .machine_file import main as write_file
        return write_file(argv)
    if '--help' in argv or '-h' in argv:
        print(help_text())
        return 0
    return run_node('machine', argv, load)


def load():
    """Import the node, which takes its time."""
    from .console import Console
    from .machine_node import MachineNode
    return MachineNode, Console(on=False)


def help_text() -> str:
    """`--help`: usage, examples, parameters with defaults."""
    from .interface import SETPOINTS
    from .machine_node import PARAMETERS
    lines = [USAGE + '\n'.join(f'  {setpoint.topic:24}{setpoint.text}, {setpoint.unit}'
                               for setpoint in SETPOINTS.values()), '',
             'parameters (* may change while it runs):']
    lines += [f'{"* " if parameter.live else "  "}{parameter.name:22}{parameter.text}'
              + ('' if parameter.default in (None, '') else f' [{parameter.default}]')
              for parameter in PARAMETERS.values()]
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
