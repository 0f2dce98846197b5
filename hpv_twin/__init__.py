"""A real-time digital twin of a small hydropulse vibrator, for ROS 2.

Each part is imported by its own name, so that none pays for another: `hpv_twin.model` is the
physics, `hpv_twin.recording` the MCAP files, `hpv_twin.node` the live twin and
`hpv_twin.viewer` the replay.
"""

__version__ = '0.1.0'
