"""One robot in simulation: body, drives, sensors, estimator, link, battery; without faults."""
