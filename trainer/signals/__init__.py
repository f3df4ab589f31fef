"""One frame of signals for each log, from which identification and diagnosis take all that they compare."""
