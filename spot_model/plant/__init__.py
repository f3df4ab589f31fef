"""The batched simulation of Spot on MuJoCo."""
