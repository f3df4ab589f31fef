"""What a Spot is: facts, state, control law, policy contract, effects, plant."""
