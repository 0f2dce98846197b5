"""`hpv-twin replay`: open a recording in rerun, laid out as an instrument panel."""
from __future__ import annotations

import argparse
import math
import os
import sys
from pathlib import Path

from hpv_twin.designs import HELP, METAVAR

ADVICE = "rerun is not installed: pip install 'hpv_twin[viewer]', in an environment with NumPy 2"

DESCRIPTION = """\
Open a recording in rerun as an instrument panel: left, a cutaway of the machine, phase portrait,
spectrum and events; middle, single cycles around the time cursor and the whole run; right, cards
with figures and design. It plays at 1/50 of real time, so that a cycle of 55 Hz lasts a second; the
space key stops and starts it.
"""
EXAMPLES = """\
examples:
  hpv-twin replay                                the newest recording in ./bags
  hpv-twin replay bags/run.mcap --from 10 --to 20
                                                 only these ten seconds
  hpv-twin replay bags/run.mcap --save run.rrd   write the scene; later: rerun run.rrd
  hpv-twin replay --live                         what the twin records now, below 1 s late
  hpv-twin replay --web                          in a browser on this machine
  hpv-twin replay others.mcap --ambient 0        a recording of gauge pressures

Recordings of others open too if they hold sensor_msgs/FluidPressure or JointState topics.
Pressures are shown as gauge pressures: the recorded absolute ones less the ambient pressure.
"""


def main(argv: list[str] | None = None) -> int:
    """Run the command and return its exit status: 1 if there is nothing to show, 2 for misuse."""
    options = _parse(argv)
    if options.live:  # that a viewer has been closed is no error
        os.environ.setdefault('RUST_LOG', 'off')
    try:
        import rerun  # noqa: F401
    except ImportError as error:
        return _fail(ADVICE if error.name == 'rerun' else f'rerun cannot be loaded: {error}')
    from hpv_twin.viewer import session
    try:
        return session.run(options)
    except session.Refusal as error:
        return _fail(str(error))
    except OSError as error:
        return _fail(f'{error.filename}: {error.strerror}' if error.filename else str(error))


def _parse(argv: list[str] | None) -> argparse.Namespace:
    """Parse the arguments; misuse ends with status 2."""
    parser = argparse.ArgumentParser(
        'hpv-twin replay', description=DESCRIPTION, epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('file', metavar='FILE', nargs='?', type=Path,
                        help='an MCAP file, or a folder: of a recording in several parts, or of '
                             'recordings, then its newest; without it, the newest in ./bags')
    parser.add_argument('--save', metavar='OUT.rrd', type=Path,
                        help='write the scene to a file instead of opening it')
    parser.add_argument('--live', action='store_true',
                        help='follow the recording while it grows; without FILE, whichever is the '
                             'newest in ./bags')
    parser.add_argument('--web', action='store_true',
                        help='show it in a browser on this machine; the address is printed')
    parser.add_argument('--from', metavar='S', type=_seconds, dest='since',
                        help='leave out what is before, in seconds from the start')
    parser.add_argument('--to', metavar='S', type=_seconds, dest='until',
                        help='leave out what is after, in seconds from the start')
    parser.add_argument('--ambient', metavar='PA', type=_finite,
                        help='ambient pressure, Pa absolute; without it, as recorded, or 101325')
    parser.add_argument('--vibrator', metavar=METAVAR, type=Path,
                        help=f'show this design: {HELP}; without it, the one in the recording')
    options = parser.parse_args(argv)
    if options.save and options.save.suffix != '.rrd':
        parser.error(f'--save {options.save}: a name that ends in .rrd is expected')
    for other, given in (('--save', options.save), ('--from', options.since),
                         ('--to', options.until)):
        if options.live and given is not None:
            parser.error(f'--live does not go with {other}: it shows what is being recorded')
    if options.web and options.save:
        parser.error('--web does not go with --save: it shows the scene at once')
    since = options.since or 0.0
    if options.until is not None and options.until <= since:
        parser.error(f'--to {options.until:g} is not after --from {since:g}')
    return options


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text} is not a finite number')
    return value


def _seconds(text: str) -> float:
    value = _finite(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f'{text} is before the start')
    return value


def _fail(text: str) -> int:
    print(f'hpv-twin replay: {text}', file=sys.stderr)
    return 1
