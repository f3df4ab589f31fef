"""Our own admin service: scenario, faults, lock-step."""
