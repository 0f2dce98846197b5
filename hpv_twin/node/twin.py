"""`hpv-twin twin`: the real-time twin as a process."""
from __future__ import annotations

import sys

from .process import run_node


def main(argv: list[str] | None = None) -> int:
    """Run the twin until a signal; 0 after an orderly end, 1 on failure, 2 for bad parameters."""
    argv = sys.argv[1:] if argv is None else argv
    if '--help' in argv or '-h' in argv:
        print(help_text())
        return 0
    return run_node('twin', argv, load)


def load():
    """Import the node, which takes its time."""
    from .console import Console
    from .node import TwinNode
    return TwinNode, Console()


def help_text() -> str:
    """`--help`: usage, examples, parameters with defaults."""
    from .interface import INPUTS, PARAMETERS
    lines = ['usage: hpv-twin twin [--ros-args -p NAME:=VALUE … -r __ns:=/NAMESPACE …]', '',
             'The real-time twin of a hydropulse vibrator. It publishes pressure and plunger',
             'position at 1 kHz, takes setpoints while it runs and records to bags/.', '',
             'examples:',
             '  hpv-twin twin',
             '  hpv-twin twin --ros-args -p pump_flow:=3.65e-4 -p record:=false',
             '  hpv-twin twin --ros-args -p vibrator:=my_vibrator.yaml -r __ns:=/left', '',
             'setpoint topics (std_msgs/msg/Float64):']
    lines += [f'  {setpoint.topic:28}{setpoint.text}, {setpoint.unit}'
              for setpoint in INPUTS.values()]
    lines += ['', 'parameters:']
    lines += [f'  {parameter.name:28}{parameter.text}'
              + ('' if parameter.default in (None, '') else f' [{parameter.default}]')
              for parameter in PARAMETERS.values()]
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
