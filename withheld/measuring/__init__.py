"""What only the judge can measure: what faults do to their robots, and how much a delivered model closes."""
