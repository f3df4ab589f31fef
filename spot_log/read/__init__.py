"""Readers of logs, whole or cut short."""
