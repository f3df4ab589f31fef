"""Clients that want to keep an operator from stopping the robot, and how soon a stop gets through all the same."""
