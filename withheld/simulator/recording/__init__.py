"""Transport, recording, and logs."""
