"""Files: model files, experiments, velocity sequences, YAML, settings, output that is whole."""
