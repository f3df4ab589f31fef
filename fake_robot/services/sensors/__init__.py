"""Cameras and perception services."""
