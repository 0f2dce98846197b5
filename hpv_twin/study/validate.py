"""`hpv-twin validate`: the paper's results, row by row, against what the twin shows."""
from __future__ import annotations

import argparse
import dataclasses
import json
import shutil
import sys
import textwrap
from pathlib import Path

from hpv_twin.designs import HELP, METAVAR, load_design
from hpv_twin.model import Vibrator, VibratorError

from .rows import ROWS, Row

EXAMPLES = """\
examples:
  hpv-twin validate                              the built-in base design: every row passes
  hpv-twin validate --vibrator my_vibrator.yaml  another design against the same results
  hpv-twin validate --vibrator bags/run.mcap     the design that a recording carries
  hpv-twin validate --json > rows.json           for a script
  hpv-twin validate --plot validation.png        the paper's Figure 6 and its cyclogram

Exit code 0 when every row passes, 1 when one fails, 2 for a design that cannot be read."""


def main(argv: list[str] | None = None) -> int:
    """Print the table; 1 if a row fails."""
    parser = argparse.ArgumentParser(
        prog='hpv-twin validate', epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Check a design against the results of Obertyukh et al. 2026, row by row.')
    parser.add_argument('--vibrator', metavar=METAVAR, help=f'{HELP}; default: the built-in one')
    parser.add_argument('--json', action='store_true', help='print the rows as JSON')
    parser.add_argument('--plot', metavar='PNG', type=Path, help='also draw the waveforms')
    arguments = parser.parse_args(argv)
    try:
        vibrator = load_design(arguments.vibrator)
    except VibratorError as error:
        print(f'hpv-twin validate: {error}', file=sys.stderr)
        return 2
    rows = measure(vibrator)
    if arguments.json:
        print(json.dumps([dataclasses.asdict(row) for row in rows], indent=2, ensure_ascii=False))
    else:
        print(table(rows, shutil.get_terminal_size((120, 24)).columns))
    if arguments.plot:
        from .pictures import draw_validation
        draw_validation(vibrator, arguments.plot)
        print(f'drawn: {arguments.plot}', file=sys.stderr)
    return 0 if all(row.passed for row in rows) else 1


def measure(vibrator: Vibrator) -> list[Row]:
    """All rows; on a terminal a line says which is being measured."""
    rows = []
    for make in ROWS:
        if sys.stderr.isatty():
            print(f'\r\x1b[2K{len(rows)} rows; next: {make.__doc__.splitlines()[0]}', end='',
                  file=sys.stderr, flush=True)
        made = make(vibrator)
        rows += made if isinstance(made, list) else [made]
    if sys.stderr.isatty():
        print('\r\x1b[2K', end='', file=sys.stderr, flush=True)
    return rows


def table(rows: list[Row], width: int) -> str:
    """The rows as text, notes indented below theirs."""
    lines = []
    for row in rows:
        verdict = 'pass' if row.passed else 'FAIL'
        lines.append(f'{verdict}  {row.result}')
        facts = f'paper: {row.paper};  twin: {row.twin};  accepted: {row.accepted}'
        for text in (facts, row.note):
            lines += textwrap.wrap(text, max(60, width - 1), initial_indent='      ',
                                   subsequent_indent='      ')
    failed = sum(not row.passed for row in rows)
    lines += ['', f'{len(rows) - failed} of {len(rows)} rows pass']
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
