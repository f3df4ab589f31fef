"""Every row of the fault matrix on a fake robot: what happens, how soon, and what is left."""
