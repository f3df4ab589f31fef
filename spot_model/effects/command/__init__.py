"""Effects on the way from the policy's action to the motor controllers."""
