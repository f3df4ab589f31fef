"""What every call passes through: access checks, headers, the link."""
