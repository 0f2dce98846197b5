"""Offline work on the model: design, validation, calibration and studies."""
