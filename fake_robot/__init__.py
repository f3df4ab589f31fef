"""A Spot as seen from the network: Boston Dynamics' own services over a simulated robot."""
