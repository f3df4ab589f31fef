"""Which effects the logs show: forward selection over effects and places, scored on unseen sequences."""
