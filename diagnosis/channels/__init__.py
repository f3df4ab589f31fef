"""Residual channels, one file each; :mod:`diagnosis.seam` says what a channel hands on."""
