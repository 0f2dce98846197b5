"""Pictures of a recording: it is read into arrays, turned into a scene and laid out for rerun.

Knows no ROS client library. rerun is imported by the modules that need it, never here.
"""
