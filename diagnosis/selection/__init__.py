"""Which effects the logs show: forward selection over effects and places, scored on sequences that the fit never saw."""
