"""Beside a running machine: holding its frequency, following it, judging its condition. No ROS."""
