"""The control process of the operator service."""
