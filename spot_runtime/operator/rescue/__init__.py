"""Making a robot safe after its control process has died."""
