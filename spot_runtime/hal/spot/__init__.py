"""The adapter for a Spot, real or fake, over the vendor's SDK."""
