"""The computer the service runs on: clocks, scheduling, systemd, journal, locks."""
