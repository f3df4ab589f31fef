"""The operator's interface: an idle service, one control process a run, and what a person asks of them."""
