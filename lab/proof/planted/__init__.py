"""Errors that a server of Spot's API can have, and a server that has one of them at a time."""
