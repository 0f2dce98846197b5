"""`python -m hpv_twin NAME` is `hpv-twin NAME`."""

import sys

from hpv_twin.cli import main

if __name__ == '__main__':
    sys.exit(main())
