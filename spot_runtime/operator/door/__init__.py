"""The service's front: connections are counted and limited here, callers named, calls admitted or refused."""
