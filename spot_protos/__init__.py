"""Our own messages, generated from ``protos/``, and what calls the services that they belong to."""
