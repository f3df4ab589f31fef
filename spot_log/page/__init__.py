"""What a person reads after a run: a summary in words and one page of plots."""
