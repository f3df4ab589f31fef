"""What shows that the product works: the demo, fault matrix, soak and speed measurements."""
