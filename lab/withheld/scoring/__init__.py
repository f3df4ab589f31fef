"""What verdicts score, with intervals, tables and pages."""
