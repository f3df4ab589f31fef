"""Who may move the robot: leases, e-stop, power, keepalive."""
