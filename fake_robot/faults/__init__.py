"""Everything that can be made to go wrong, by name, on the wire and in the body."""
