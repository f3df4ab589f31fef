"""What is decided and said: gap, causes, unknown, advice."""
