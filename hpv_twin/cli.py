"""The one console script, `hpv-twin NAME …`: it finds the command and hands over.

A command is a module with `main(argv: list[str]) -> int`. It is imported only when it is called, so
that `--help` is instant and no command needs what another one needs. A new command is one line in
COMMANDS and, for `ros2 run`, one link in launchers/.
"""

import difflib
import os
import sys
from importlib import import_module
from typing import NamedTuple

from hpv_twin import __version__

PROG = 'hpv-twin'


class Command(NamedTuple):
    """Where a command lives, and what it does in a line."""

    module: str
    summary: str


COMMANDS = {
    'twin': Command('hpv_twin.node.twin', 'run the twin: a ROS 2 node that publishes and records'),
    'machine': Command('hpv_twin.node.machine', 'a stand-in for a real machine: sensors, faults'),
    'demo': Command('hpv_twin.node.demo', 'a machine, its twin, a fault, the alarm, the replay'),
    'setpoint': Command('hpv_twin.node.setpoint', 'give a running twin new setpoints'),
    'replay': Command('hpv_twin.viewer.replay', 'open a recording in rerun'),
    'recover': Command('hpv_twin.recording.recover', 'make a damaged recording readable'),
    'validate': Command('hpv_twin.study.validate', "check a design against the paper's results"),
    'optimise': Command('hpv_twin.study.optimise', 'search designs best for several objectives'),
    'sensitivity': Command('hpv_twin.study.sensitivity', 'what each field of a design changes'),
    'calibrate': Command('hpv_twin.study.calibrate', 'fit a design to the sensors of a machine'),
    'sweep': Command('hpv_twin.study.sweep', 'map what a machine does over flow and preload'),
}

EXAMPLES = f"""\
examples:
  {PROG} twin                                      the base design: 55 Hz, 16.0 MPa gauge
  {PROG} twin --ros-args -p pump_flow:=3.65e-4     start at half the flow, 21.9 L/min
  {PROG} setpoint --pump-flow 3.65e-4              the same while it runs (m³/s)
  {PROG} setpoint --preload 6e-3                   a stronger preload (m)
  {PROG} machine --to-file machine.mcap            what its sensors show, as a file
  {PROG} demo                                      a machine followed, a fault, the alarm
  {PROG} replay                                    look at the newest recording
  {PROG} recover damaged.mcap -o whole.mcap
  {PROG} validate --plot validation.png            the model against the paper
  {PROG} calibrate machine.mcap -o machine.yaml    the design of a machine, by its sensors
  {PROG} sweep --want-frequency 80 --plot map.png  the operating map; settings that give 80 Hz
  {PROG} sensitivity --plot tornado.png            what each field of the design changes
  {PROG} optimise --plot front.png --design b.yaml search the best designs; write one of them

`{PROG} NAME --help` tells the rest. With ROS 2, `ros2 run hpv_twin NAME …` is the same."""

ROS_ADVICE = (
    'on a ROS 2 machine: source /opt/ros/jazzy/setup.bash; '
    "elsewhere (x86-64 Linux): pip install 'hpv_twin[ros]'"
)
VIEWER_ADVICE = "pip install 'hpv_twin[viewer]', in an environment with NumPy 2"
STUDY_ADVICE = "pip install 'hpv_twin[study]'"

# What may rightly be missing, by the name it is imported under.
OPTIONAL = {
    'rclpy': ROS_ADVICE,
    'builtin_interfaces': ROS_ADVICE,
    'diagnostic_msgs': ROS_ADVICE,
    'rcl_interfaces': ROS_ADVICE,
    'rosgraph_msgs': ROS_ADVICE,
    'sensor_msgs': ROS_ADVICE,
    'std_msgs': ROS_ADVICE,
    'std_srvs': ROS_ADVICE,
    'rerun': VIEWER_ADVICE,
    **dict.fromkeys(('dask', 'distributed', 'joblib', 'matplotlib', 'pymoo', 'tqdm'), STUDY_ADVICE),
    'pyarrow': 'pip install pyarrow',
    # colcon installs no dependencies, so these are missed too.
    'mcap': 'pip install mcap',
    'numba': 'pip install numba',
    'numpy': 'pip install numpy',
    'scipy': 'pip install scipy',
    'yaml': 'pip install PyYAML',
    'zstandard': 'pip install zstandard',
}


def main(argv: list[str] | None = None) -> int:
    """Run `hpv-twin` with these arguments (sys.argv's by default) and return the exit status."""
    argv = sys.argv[1:] if argv is None else argv
    try:
        status = dispatch(argv)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Python flushes stdout once more at exit and would complain there.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    return status


def dispatch(argv: list[str]) -> int:
    """Answer the options of `hpv-twin` itself, or run the command that is named first."""
    if not argv:
        print(usage(), file=sys.stderr)
        return 2
    name, *rest = argv
    if name in ('-h', '--help'):
        print(usage())
        return 0
    if name == '--version':
        print(f'hpv_twin {__version__}')
        return 0
    if name not in COMMANDS:
        print(unknown(name), file=sys.stderr)
        return 2
    return run(name, rest)


def run(name: str, argv: list[str]) -> int:
    """Import a command and run it; say in one line what is not installed."""
    try:
        return import_module(COMMANDS[name].module).main(argv)
    except ImportError as error:
        advice = OPTIONAL.get((error.name or '').partition('.')[0])
        if advice is None:
            raise
        print(f'{PROG} {name}: {error} ({sys.executable}). To install it: {advice}',
              file=sys.stderr)
        return 1


def usage() -> str:
    """Return the text of `hpv-twin --help`."""
    width = max(map(len, COMMANDS)) + 2
    lines = [f'  {name:{width}}{command.summary}' for name, command in COMMANDS.items()]
    return '\n'.join([
        f'usage: {PROG} NAME …  |  {PROG} --help  |  {PROG} --version',
        '',
        'A real-time digital twin of a small hydropulse vibrator.',
        '',
        'commands:', *lines,
        '',
        EXAMPLES,
    ])


def unknown(name: str) -> str:
    """Return what to say of a name that is no command."""
    near = difflib.get_close_matches(name, COMMANDS, n=1)
    hint = f" Did you mean '{near[0]}'?" if near else ''
    kind = 'option' if name.startswith('-') else 'command'
    return f"{PROG}: no {kind} '{name}'.{hint} There are: {', '.join(COMMANDS)}; see {PROG} --help."
