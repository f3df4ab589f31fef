"""Reaching a robot: address, credentials, certificates, time sync."""
