"""Which cases are drawn: kinds, sizes, places, motions, logs."""
