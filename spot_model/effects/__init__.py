"""The effects: one file each; :mod:`spot_model.effects.base` says what an effect is."""
