"""The effects that the diagnosis knows, by what they belong to."""
