"""Two programs that run by themselves, on the standard library alone: they lock the diagnosing process in."""
