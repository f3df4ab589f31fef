"""Runs cases blind: the reality records, a process without the truth diagnoses, and only then are the two compared."""
