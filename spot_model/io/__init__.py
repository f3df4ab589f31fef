"""Files and command line: model files, velocity sequences, YAML, validation."""
