"""What each effect predicts in each channel, one object an effect."""
