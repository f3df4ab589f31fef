"""What to record next: a short menu, each recording with how much surer it makes the numbers that are in doubt."""
