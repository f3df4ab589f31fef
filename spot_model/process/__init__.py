"""Processes: how one is started, ended, signalled, and what it has from its parent."""
