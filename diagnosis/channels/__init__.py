"""Residual channels, one file each; :mod:`diagnosis.channels.channel_view` says what a channel hands on."""
