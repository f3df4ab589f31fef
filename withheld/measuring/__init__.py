"""What only the judge can measure: distances between robots, S of a delivered model, and the best possible answer."""
