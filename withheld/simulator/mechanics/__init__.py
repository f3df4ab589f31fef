"""Body, drives, friction, heat and supply."""
