"""The search over parameters by CMA-ES."""
