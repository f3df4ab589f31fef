"""The operator's service: idle until asked, with one control process a run."""
