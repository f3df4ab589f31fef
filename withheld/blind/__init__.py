"""Runs cases blind: the reality records, its truth is sealed, the diagnosis is locked in, then the seal is opened."""
