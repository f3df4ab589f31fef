"""The operator service: requests, access, supervision of the control process."""
