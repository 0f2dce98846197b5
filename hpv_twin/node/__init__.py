"""The live twin: topics, parameters and services around the model, pacing and health."""
