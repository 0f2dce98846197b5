"""Recordings: MCAP files that explain themselves, written while the twin runs and read back.

Knows bytes, schemas and times; no model, no ROS client library.
"""

from hpv_twin import __version__

LIBRARY = f'hpv_twin {__version__}'  # what writes the files
